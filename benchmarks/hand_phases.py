"""How well phases and shapes of hands are told, against the script of the generated signing motion.

Its script knows when a wrist goes from one place to another and when it stays: two keys within 3 cm of each other are a
stop, which counts if it lasts at least 0.1 s. Each sequence is fitted to simulated detections, with their noise, gaps
and swapped arms. The rule's values were chosen on the sequences "tuned"; "measured" are other people, cameras, paces
and chances. A boundary is where movement begins or ends; it is found if one of its kind is within 0.25 s of it.
A handshape is right if it is that of the script's key in the middle of a hold.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

from benchmarks.handshapes import Handshapes, captioned, hand_picture, scene
from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.acting.script import ArmKey, Build
from evaluation.synthetic.studio.view import View
from evaluation.synthetic.suite import MOTIONS, SEQUENCES, SUBJECTS, SuiteSequence, make_sequence, subject_body
from fitting_core.body.geometry import SIDES, Side
from fitting_core.body.handshapes import HANDSHAPES
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS
from fitting_core.files.atomic import replacing
from fitting_core.fit.fitting import fit_clip
from fitting_core.keypoints import LEFT_HAND
from fitting_core.measure.hands.handshapes import HandshapeSet
from fitting_core.measure.hands.phases import HOLD, hand_phases
from tcfit_app.analysis.hand_tiers import handshapes, visible_frames
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tests.samples.scripted_phases import Agreement, agreement, scripted_phases


def _signing(name: str, subject: int, frames: int, seed: int, azimuth: float, distance: float) -> SuiteSequence:
    view = View(azimuth=azimuth, height=1.3, distance=distance, looking_at=(0.0, 1.15, 0.0))
    base = SEQUENCES["signing_1"]
    return replace(base, name=name, subject=SUBJECTS[subject], frames=frames, seed=seed, view=view)


TUNED = {"signing_1": SEQUENCES["signing_1"], "signing_b": _signing("signing_b", 0, 160, 331, -14, 2.8)}
MEASURED = {
    "signing_c": _signing("signing_c", 2, 230, 342, 12, 2.7),
    "signing_d": _signing("signing_d", 4, 190, 353, -6, 2.9),
    "signing_e": _signing("signing_e", 5, 210, 364, 18, 2.6),
}


@dataclass(frozen=True, kw_only=True)
class HandPhases:
    """Which sequences, and how hard their detections are."""

    sheet: Positional[Path | None] = None
    """Only draw the named handshapes, from the palm and turned by 80 degrees, into this picture."""
    level: str = "normal"
    tuned: bool = False
    """Those that the values were chosen on."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def _keys(sequence: SuiteSequence, side: Side) -> Sequence[ArmKey]:
    build = Build.of(subject_body(sequence.subject), sequence.subject.betas)
    rng = np.random.default_rng([sequence.seed, 1])
    return MOTIONS[sequence.motion](build, sequence.seconds, rng)[0].arms[side]


def _scripted_shape(sequence: SuiteSequence, side: Side, frames: range) -> str:
    """That of the key nearest to the middle of some frames."""
    middle = (frames.start + frames.stop - 1) / 2 / sequence.frame_rate
    return min(_keys(sequence, side), key=lambda key: abs(key.time - middle)).shape


def _fitted(
    sequence: SuiteSequence, level: str, body: BodyModel
) -> Iterator[tuple[str, Float[np.ndarray, "T 55 3"], PosedFit | None]]:
    """The joints of the truth, and those of the fit with all that is known of it."""
    made = make_sequence(sequence, level)
    yield "the true motion", joints_in_space(made.body, made.truth.params), None
    clip: Clip = made.clip
    posed = PosedFit.of(clip, fit_clip(clip, body, PRESETS["tcfit"]), Meshes(body))
    yield f"a fit to {level} detections", posed.joints, posed


def run(options: HandPhases) -> None:
    """Fits, compares, reports; or draws the named handshapes."""
    body = options.common.load_body()
    if options.sheet is not None:
        with replacing(options.sheet) as draft:
            cv2.imwrite(str(draft), sheet(body)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
        return
    of: dict[str, list[Agreement]] = {}
    shapes: list[tuple[str, str, float, bool]] = []
    for name, sequence in (TUNED if options.tuned else MEASURED).items():
        progress(name)
        for what, joints, posed in _fitted(sequence, options.level, body):
            for side in SIDES:
                times = np.arange(sequence.frames) / sequence.frame_rate
                truth = scripted_phases(_keys(sequence, side), times)
                spans = hand_phases(joints, side, sequence.frame_rate)
                of.setdefault(what, []).append(agreement(truth, spans, sequence.frame_rate))
                if posed is None:
                    continue
                seen = visible_frames(posed, side)
                for frames, near in handshapes(posed, HandshapeSet(body), side, spans, seen):
                    if truth[(frames.start + frames.stop) // 2] == HOLD:
                        shapes.append((_scripted_shape(sequence, side, frames), near.name, near.degrees, near.near))
    report(
        options,
        {"phases": [_row(what, found) for what, found in of.items()], "handshapes of holds": _shape_rows(shapes)},
    )


def _row(what: str, found: Sequence[Agreement]) -> Row:
    off = np.abs([ms for one in found for ms in one.off])
    there = len(off) + sum(one.missed for one in found)
    return {
        "on": what,
        "frames alike %": 100 * float(np.mean([one.same for one in found])),
        "boundaries": there,
        "found %": 100 * len(off) / there,
        "off by, median ms": float(np.median(off)),
        "off by, mean ms": float(off.mean()),
        "too many": sum(one.extra for one in found),
    }


def _shape_rows(found: Sequence[tuple[str, str, float, bool]]) -> list[Row]:
    """For each scripted shape: how often it was named, and what else."""
    rows: list[Row] = []
    for shape in [*dict.fromkeys(one[0] for one in found), "all"]:
        mine = [one for one in found if shape in ("all", one[0])]
        others = sorted({name for scripted, name, _, near in mine if name != scripted or not near})
        rows.append({
            "shape": shape,
            "holds": len(mine),
            "right %": 100 * float(np.mean([name == scripted and near for scripted, name, _, near in mine])),
            "unclear %": 100 * float(np.mean([not near for *_, near in mine])),
            "mean distance °": float(np.mean([degrees for _, _, degrees, _ in mine])),
            "others": ", ".join(others) if shape != "all" else "",
        })  # fmt: skip
    return rows


def sheet(body: BodyModel) -> np.ndarray:
    """The named handshapes of the left hand, seen from the palm and turned by 80 degrees."""
    at = scene(body, Handshapes(views=("palm",)))
    vertices, cells = Mesh(body, dtype=torch.float64)(at.truth).numpy(), []
    for i, name in enumerate(HANDSHAPES):
        crops = [hand_picture(body, vertices[i], at.space[i, LEFT_HAND], "left", degrees) for degrees in (0.0, 80.0)]
        cells.append(captioned(np.concatenate(crops, 1), name))
    blank = np.full_like(cells[0], 255)
    cells += [blank] * (-len(cells) % 4)
    return np.concatenate([np.concatenate(cells[i : i + 4], 1) for i in range(0, len(cells), 4)])


if __name__ == "__main__":
    start(HandPhases, run)
