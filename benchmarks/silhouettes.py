"""Shape from silhouettes on the generated suite: how far volume and distance are off, without them and with them.

Each sequence is fitted as the suite is. The frames in which phase 2 found a shape are then drawn in clothes of several
thicknesses (shirt and trousers; forearms, neck and feet are bare), MediaPipe's network finds the silhouettes in these
pictures, and with them the shape is found again. Drawn people are easier for it than filmed ones: a second row has its
borders made more uneven.

People 1, 2 and 6 are looked at while something is tuned; 3, 4 and 5 are kept apart.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.studio.clothing import Outfit
from evaluation.synthetic.studio.studio import Studio
from evaluation.synthetic.suite import SEQUENCES, SUBJECTS, SuiteClip, make_sequence
from fitting_core.body.geometry import vertex_normals
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.config.schema import PRESETS
from fitting_core.detect.detectors import DEFAULT, find_detector
from fitting_core.detect.mediapipe.detector import MediaPipe, silhouette
from fitting_core.errors import InputError
from fitting_core.fit.events import drained
from fitting_core.fit.fitting import clip_stages, fit_clip
from fitting_core.fit.fused import ready
from fitting_core.fit.phases.outlines import border_distance, outlined_shape
from fitting_core.fit.phases.shared_shape import SampledShape, Sight, fit_shape
from fitting_core.fit.solvers import make_solver
from fitting_core.fit.variables.state import State
from fitting_core.measure.mesh.volume import Enclosed
from fitting_core.silhouettes import Silhouettes, silhouette_size

LOOKED_AT = (1, 2, 6)
"""People by number; the others are kept apart."""
_SEQUENCES = (*(f"simple_{i}" for i in range(1, 7)), "complex_3", "complex_5", "complex_6")
_QUICK = ("simple_2", "simple_6")
_SMALL = 0.5
"""Of the suite's pictures: the network sees 256 pixels of a square around the person."""
_UNEVEN, _BUMP = 0.7, 3.0
"""Pixels of a mask by which borders are made uneven, and about how long the bumps are."""

Mask = Bool[np.ndarray, "h w"]
Image = UInt8[np.ndarray, "H W 3"]


@dataclass(frozen=True, kw_only=True)
class ShapeFromSilhouettes:
    """What to measure."""

    sequences: tuple[str, ...] = _SEQUENCES
    clothes_cm: tuple[float, ...] = (0.0, 1.0, 2.0)
    quick: bool = False
    """Only a heavy and a light person, in clothes of 1 cm."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Of a shape, and of the frames that it was found in."""

    volume: float
    """dm³; more than the true one is positive."""
    by_height: float
    """dm³ by which somebody as stout would be off for being as much too tall."""
    distance: float
    """Per cent of the true one, of the pelvis, on average."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """With the silhouettes of somebody's clothes."""

    errors: Errors
    clothes: float
    """Metres, as found."""
    seconds: float
    """Of processor time."""
    unevenness: float
    """Of the masks: robust standard deviation of the border from the true one, in pixels of a mask."""
    outside: float
    """Metres that the border lies outside the true one, in the median."""


@dataclass(frozen=True, kw_only=True)
class Person:
    """A sequence, without silhouettes and with them."""

    name: str
    number: int
    true: float
    """dm³."""
    before: Errors
    found: dict[tuple[float, float], Found | None]
    """By the thickness of clothes in centimetres, and pixels by which masks were made uneven. None: no shape came of
    them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """A sequence after phase 2, without silhouettes."""

    made: SuiteClip
    sight: Sight
    shape: SampledShape

    @staticmethod
    def of(name: str, body: BodyModel) -> "Fitted":
        """Fit a sequence of the suite."""
        made, config = make_sequence(SEQUENCES[name]), replace(PRESETS["tcfit"], last_phase=1)
        first = fit_clip(made.clip, body, config)
        sight = Sight.after_first_phase(clip_stages(made.clip, body, config), first)
        shape = drained(fit_shape([sight], make_solver(config.solver, config.settings), config.shape_sample))
        return Fitted(made=made, sight=sight, shape=shape)

    @property
    def frames(self) -> list[int]:
        """Those in which the shape was found."""
        return self.shape.frames[0].tolist()

    def errors(self, state: State) -> Errors:
        """Of those frames and their shape."""
        stages, made = self.sight.stages, self.made
        betas = state.vector[0, stages.parametrisation.columns.betas].double().cpu().numpy()
        found, true = (b.with_shape(s).template for b, s in ((stages.body, betas), (made.body, self.true_betas)))
        taller = np.ptp(found[:, 1]) / np.ptp(true[:, 1])
        volume = self.true_volume
        pelvis = joints_in_space(stages.body, stages.parametrisation.to_params(state))[:, 0, 2]
        return Errors(
            volume=float(Enclosed.of(stages.body.faces)(found[None])[0]) - volume,
            by_height=float(volume * (taller**3 - 1)),
            distance=float(100 * abs(pelvis / made.truth.joints[self.frames, 0, 2] - 1).mean()),
        )

    @property
    def true_betas(self) -> Float[np.ndarray, "10"]:
        """Of the subject's own body."""
        return np.array(self.made.sequence.subject.betas)

    @property
    def true_volume(self) -> float:
        """In dm³."""
        body = self.made.body
        return float(Enclosed.of(body.faces)(body.with_shape(self.true_betas).template[None])[0])

    def with_masks(self, masks: Sequence[Mask | None], true: Sequence[Mask]) -> Found | None:
        """The shape again with the silhouettes of its frames, whose true ones are known."""
        by_frame = {t: np.packbits(mask) for t, mask in zip(self.frames, masks, strict=True) if mask is not None}
        packed = [by_frame.get(t) for t in range(len(self.made.clip))]
        silhouettes = Silhouettes.of(packed, silhouette_size(self.made.clip.camera.size))
        begun = time.process_time()
        stages = replace(self.sight.stages, silhouettes=silhouettes)
        shape = outlined_shape([(stages, self.shape.frames[0])], self.shape.state)
        seconds = time.process_time() - begun
        if shape is None:
            return None
        apart = np.concatenate([_apart(m, t) for m, t in zip(masks, true, strict=True) if m is not None])
        metre = stages.camera.focal[0] / np.median(self.made.truth.joints[self.frames, 0, 2])
        return Found(
            errors=self.errors(shape.state),
            clothes=shape.clothes,
            seconds=seconds,
            unevenness=float(1.4826 * np.median(abs(apart - np.median(apart)))),
            outside=float(np.median(apart) * max(stages.camera.size) / max(silhouettes.size) / metre),
        )


def _apart(mask: Mask, true: Mask) -> Float[np.ndarray, "n"]:
    """Pixels of the mask from the border of a true one, which may be larger, out to the border of the mask."""
    scale = len(true) / len(mask)
    y, x = np.nonzero(abs(border_distance(true)) < 1)
    across, down = (((at + 0.5) / scale - 0.5).astype(np.float32)[:, None] for at in (x, y))
    own = cv2.remap(border_distance(mask).astype(np.float32), across, down, cv2.INTER_LINEAR)[:, 0]
    return own - border_distance(true)[y, x] / scale


def dressed(made: SuiteClip, frames: Sequence[int], thickness: float) -> Iterator[tuple[Image, Mask]]:
    """Small pictures (RGB) of a sequence's person in clothes (metres), and what they cover of each."""
    camera, (width, height) = made.truth.camera, made.truth.camera.size
    small = replace(
        camera,
        focal=(_SMALL * camera.focal[0], _SMALL * camera.focal[1]),
        center=(_SMALL * camera.center[0], _SMALL * camera.center[1]),
        size=(round(_SMALL * width), round(_SMALL * height)),
    )
    body, own, outfit = made.body, made.view.pose(), Outfit.of(made.body)
    studio = Studio(small, seat_height=None, view=made.view)
    worn = np.max([amount for _, amount in outfit.clothes(outfit.paint[:, :3])], axis=0)
    for vertices in shared_mesh(body)(made.truth.params[list(frames)]).double().numpy():
        world = (vertices - own.translation) @ own.rotation
        world += thickness * worn[:, None] * vertex_normals(world, body.faces)
        image, depth = studio.draw(world, body.faces, vertex_normals(world, body.faces), outfit)
        yield image, np.isfinite(depth)


def mask_in(detector: MediaPipe, image: Image) -> Mask | None:
    """What the surest person covers of an image, as the detector finds somebody whom it follows: looked at in the
    square that comes of their body and not of the first look."""
    squares = detector.everybody_in(image, harder=True)
    if not squares:
        return None
    followed = detector.body_in(image, detector.body_in(image, squares[0]).next_square)
    return silhouette(followed, (image.shape[1], image.shape[0]))


def uneven(mask: Mask, pixels: float, rng: np.random.Generator) -> Mask:
    """The mask with a border that is off by so many pixels (a standard deviation), in bumps."""
    bumps = cv2.GaussianBlur(rng.normal(size=mask.shape), (0, 0), _BUMP)
    return border_distance(mask) + pixels / bumps.std() * bumps > 0


def person(options: ShapeFromSilhouettes, name: str, detector: MediaPipe, body: BodyModel) -> Person:
    """Fit a sequence, and find its shape again with each kind of silhouettes."""
    fitted, found = Fitted.of(name, body), dict[tuple[float, float], Found | None]()
    for thickness in options.clothes_cm:
        pictures = list(dressed(fitted.made, fitted.frames, thickness / 100))
        masks, true = [mask_in(detector, image) for image, _ in pictures], [covered for _, covered in pictures]
        chances = [np.random.default_rng([fitted.made.sequence.seed, frame]) for frame in fitted.frames]
        rough = [mask if mask is None else uneven(mask, _UNEVEN, rng) for mask, rng in zip(masks, chances, strict=True)]
        found[thickness, 0.0], found[thickness, _UNEVEN] = (fitted.with_masks(own, true) for own in (masks, rough))
    return Person(
        name=name,
        number=SUBJECTS.index(fitted.made.sequence.subject) + 1,
        true=fitted.true_volume,
        before=fitted.errors(fitted.shape.state),
        found=found,
    )


def row(one: Person) -> Row:
    """A sequence's line, with masks as the network finds them."""
    cells: dict[str, str | float | None] = {
        "sequence": one.name,
        "kept apart": "" if one.number in LOOKED_AT else "yes",
        "volume dm³": one.true,
        "error before": f"{one.before.volume:+.1f}",
    }
    for (thickness, rough), found in one.found.items():
        if not rough:
            words = (
                found and f"{found.errors.volume:+.1f} ({found.errors.by_height:+.1f}; {100 * found.clothes:.1f} cm)"
            )
            cells[f"in {thickness:g} cm (by height; clothes found)"] = words or "none"
            cells[f"distance % in {thickness:g} cm"] = (
                found and f"{one.before.distance:.1f} → {found.errors.distance:.1f}"
            )
    return cells


def means(people: Sequence[Person], which: str) -> Iterator[Row]:
    """A line for each thickness and unevenness, over people whose shape was found."""
    for kind in people[0].found if people else ():
        both = [(one.before, found) for one in people if (found := one.found[kind]) is not None]
        if both:
            before, found = zip(*both, strict=True)
            yield {
                "people": f"{which} ({len(both)} of {len(people)} sequences)",
                "clothes cm": f"{kind[0]:g}",
                "border uneven by px": float(np.mean([one.unevenness for one in found])),
                "outside by mm": f"{1e3 * np.mean([one.outside for one in found]):+.1f}",
                "|volume error| before": float(np.mean([abs(one.volume) for one in before])),
                "after dm³": float(np.mean([abs(one.errors.volume) for one in found])),
                "beyond height": float(np.mean([abs(one.errors.volume - one.errors.by_height) for one in found])),
                "distance before": float(np.mean([one.distance for one in before])),
                "after %": float(np.mean([one.errors.distance for one in found])),
                "s": float(np.mean([one.seconds for one in found])),
            }


def run(options: ShapeFromSilhouettes) -> None:
    """Fit, draw, detect, find the shapes again, and report by person and over all."""
    if options.quick:
        options = replace(options, sequences=_QUICK, clothes_cm=(1.0,))
    if unknown := set(options.sequences) - set(SEQUENCES):
        raise InputError(f"--sequences {' '.join(sorted(unknown))}: expected some of {', '.join(SEQUENCES)}.")
    ready.use(threads=options.common.threads)
    detector, body = find_detector(DEFAULT), options.common.load_body()
    assert isinstance(detector, MediaPipe)
    people = []
    for name in options.sequences:
        people.append(person(options, name, detector, body))
        progress(", ".join(f"{key} {value}" for key, value in row(people[-1]).items()))
    apart = [one for one in people if one.number not in LOOKED_AT]
    looked_at = [one for one in people if one.number in LOOKED_AT]
    groups = {"all": people, "looked at": looked_at, "kept apart": apart}
    over = [line for which, own in groups.items() for line in means(own, which)]
    report(options, {"By person": [row(one) for one in people], "Means": over})


if __name__ == "__main__":
    start(ShapeFromSilhouettes, run)
