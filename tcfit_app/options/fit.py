"""The options of `tcfit fit`, and how they become a FitConfig. Imports nothing heavy."""

from collections.abc import Iterator
from dataclasses import dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructFieldSpec, StructTypeInfo

from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.config.choices import FocalRule
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.config.settings import changed, check, settings, unknown
from fitting_core.config.toml import preset, read_named
from fitting_core.detect.detectors import DEFAULT, DETECTORS
from fitting_core.errors import InputError


def shown(metavar: str, default: str, text: str | None = None) -> Any:
    """The help of an optional argument; `text` replaces the text of its field."""
    return arg(metavar=metavar, help=text, help_behavior_hint=f"(default: {default})")


Video = Annotated[Positional[Path | None], arg(metavar="VIDEO", help_behavior_hint="(required without --keypoints)")]
KeypointFiles = Annotated[Path | None, shown("PATH", "keypoints/ of the SMPLify-X layout, or detected in the video")]
JsonLines = Annotated[bool, arg(help="Print progress as JSON, one event per line.")]
ModelsFolder = Annotated[Path | None, shown("DIR", "see tcfit models", "Search only this folder for body models.")]
RunName = Annotated[str | None, shown("NAME", "the newest", "Run of the project: its name or number.")]
Phase = Annotated[
    Literal[1, 2, 3] | None,
    shown("{1,2,3}", "the last", "Phase of the fit. 1: each frame on its own; 2: one shape; 3: consistent over time."),
]


@dataclass(frozen=True, kw_only=True)
class ReferenceOptions:
    """A reference to compare fits with; stored in the project."""

    reference: Annotated[Path | None, shown("PATH", "none")] = None
    """3D points (npz, TRC, C3D), an AMASS-style npz, a truth.npz, or another fit.npz."""
    reference_camera: Annotated[Path | None, shown("FILE.npz", "that of the clip's calibration")] = None
    """The clip's camera in the reference's world: R and t with x_camera = R x + t. Without it, positions and depth
    are not compared."""
    reference_first_frame: Annotated[int | None, shown("N", "as recorded, or 0")] = None
    """Video frame at which the reference begins, if the reference was trimmed and does not record it."""


NO_KEYPOINTS = Path("none")
"""The value of --keypoints for a project without keypoints."""
DETECTOR_NAMES = f"{', '.join(DETECTORS)}, or an ONNX model of the RTMPose family. See `tcfit models`."

SHORTCUTS = {
    "temporal_weight": "temporal.weight",
    "window_size": "temporal.window_size",
    "shape_sample": "shape_sample.size",
    "height": "height",
    "device": "device",
}
"""Options that set a single setting: option, setting."""


def _shortcut(option: str, text: str = "") -> Any:
    """The help of an option of SHORTCUTS; without `text`, that of the setting."""
    setting = settings()[SHORTCUTS[option]]
    return shown(setting.metavar, "the preset's", text or setting.doc)


HINTS: dict[type, dict[str, Any]] = {
    ClipOptions: {
        "detector": shown("NAME", DEFAULT, f"Detector for a video without keypoints: {DETECTOR_NAMES}"),
        "person": shown("N", "follow the most prominent"),
        "first_frame": shown("N", "the first"),
        "last_frame": shown("N", "the last"),
        "frame_rate": shown("FPS", "the video's, or 30"),
        "keypoint_scale": arg(metavar="{auto,pixels,0..1,-1..1}"),
        "image_size": shown("W H", "the video's, or guessed from the keypoints"),
    },
    CameraOptions: {
        "focal_length": shown("PX|auto|diagonal", "auto; diagonal with the presets paper and smplifyx"),
        "fov": shown("DEGREES", "not given"),
        "focal_length_35mm": shown("MM", "not given"),
        "center": shown("X Y", "the centre of the image"),
        "camera": shown("FILE", "none"),
        "camera_name": shown("NAME", "the only one"),
        "camera_unit": shown("METRES", "1, estimated if it moves"),
        "camera_up": shown("{x,y,z,-x,-y,-z}", "as the file states; z for TOML"),
    },
}
"""Metavar and default of the library's options, by name; their texts are in the library."""


def registry_of_hints() -> ConstructorRegistry:
    """The registry with which a command line is parsed, so that the library's options have their HINTS."""
    registry, asked = ConstructorRegistry(), set[type]()

    def shown_field(kind: type, field: StructFieldSpec) -> StructFieldSpec:
        text = field.helptext() if callable(field.helptext) else field.helptext
        # The help would break its lines where the docstring does.
        joined = None if text is None else " ".join(text.split())
        hinted = Annotated[field.type, HINTS[kind][field.name]] if kind in HINTS else field.type
        return replace(field, type=hinted, helptext=joined)

    @registry.struct_rule
    def rule(info: StructTypeInfo) -> StructConstructorSpec | None:
        kind = info.type if isinstance(info.type, type) else type(None)
        if not is_dataclass(kind) or kind in asked:
            return None
        asked.add(kind)  # the next rule is asked, which reads any dataclass
        try:
            spec = ConstructorRegistry.get_struct_spec(info)
        finally:
            asked.remove(kind)
        assert isinstance(spec, StructConstructorSpec)
        return replace(spec, fields=tuple(shown_field(kind, field) for field in spec.fields))

    return registry


@dataclass(frozen=True, kw_only=True)
class StartOptions:
    """Another system's result, from which phase 1 starts. Frames without a result are fitted as usual."""

    start: Annotated[Path | None, shown("RESULT", "none")] = None
    """A result of GVHMR, GEM, WHAM, PromptHMR, 4D-Humans or SAM 3D Body, SMPLify-X's output folder, an npz of SMPL-X
    or AMASS, or a fit of tcfit. The format is recognised."""
    start_person: Annotated[int | None, shown("N", "the person at the keypoints; for SMPLify-X, person 0")] = None
    """Person in the result, as numbered there."""
    start_first_frame: Annotated[int | None, shown("N", "from its file names, or the clip's first")] = None
    """Video frame at which the result begins."""


FOUND = "auto"
"""A value of --other-... that leaves it to be found."""


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """Videos of the person at the same time by other cameras, which may stand and begin anywhere.

    Each further option is given once for each --other-view, in their order; auto leaves one out.
    """

    other_view: Annotated[
        UseAppendAction[tuple[Path, ...]], arg(metavar="VIDEO", help_behavior_hint="(repeatable)")
    ] = ()
    """A video file, or a folder of images."""
    other_keypoints: Annotated[UseAppendAction[tuple[Path, ...]], shown("PATH", "detected")] = ()
    """Its keypoints, as of --keypoints."""
    other_focal_length: Annotated[UseAppendAction[tuple[float | FocalRule, ...]], shown("PX|auto|diagonal", FOUND)] = ()
    """As --focal-length."""
    other_person: Annotated[UseAppendAction[tuple[int | Literal["auto"], ...]], shown("N", "the most prominent")] = ()
    """As --person."""
    other_first_frame: Annotated[UseAppendAction[tuple[int | Literal["auto"], ...]], shown("N", "the first")] = ()
    """As --first-frame."""


@dataclass(frozen=True, kw_only=True)
class BodyOptions:
    """The body model; `tcfit models` lists those found."""

    body_model: Annotated[str, arg(metavar="{smplx,smplh,smpl}|PATH")] = "smplx"
    """Kind of body model, or a model file."""
    models: ModelsFolder = None
    gender: Annotated[str, arg(metavar="{neutral,male,female,child}")] = "neutral"
    """Gender of the body model. child: the free body of a child of about 2 to 13 years."""


@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """The method. --config overrides the preset, and these options override both."""

    preset: Annotated[str | None, shown("{" + ",".join(PRESETS) + "}", f"that of --config, or {DEFAULT_PRESET}")] = None
    """smplifyx: phase 1 as in SMPLify-X; paper: as published; tcfit: most accurate."""
    config: Annotated[Path | None, shown("FILE.toml", "none")] = None
    """Settings in TOML. `tcfit settings` prints a file with all of them."""
    temporal_weight: Annotated[str | None, _shortcut("temporal_weight", "Weight w_T of the temporal term.")] = None
    window_size: Annotated[str | None, _shortcut("window_size", "Number of frames in a sliding window.")] = None
    shape_sample: Annotated[str | None, _shortcut("shape_sample", "Number of frames that estimate the shape.")] = None
    height: Annotated[
        str | None, _shortcut("height", "The person's height in centimetres. It determines the distance.")
    ] = None
    device: Annotated[str | None, _shortcut("device", "Device for torch: cpu, cuda, cuda:1, mps.")] = None
    set: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME=VALUE", help_behavior_hint="(repeatable)")] = ()
    """Any setting of `tcfit settings`, by its dotted name: --set weights.body_pose=404,404,57.4,4.78,4.78"""


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Fit the body to a clip: each frame on its own, one shape, then consistency over time.

    A video is enough: without --keypoints, they are detected. The --out folder receives fit.npz (SMPL-X parameters of
    the first and the last phase), summary.json and, with a video, overlay.mp4. Ctrl-C keeps finished phases.
    """

    video: Video = None
    """A video file, a folder of images, or a folder in SMPLify-X layout (images/ and keypoints/ inside)."""
    keypoints: KeypointFiles = None
    """OpenPose JSON (a folder, or one file), COCO-WholeBody JSON, or a .pose file."""
    out: Annotated[Path, arg(metavar="DIR")]
    """Folder for the result. An existing result is replaced."""
    people: Annotated[Literal["all"] | None, shown("all", "one person")] = None
    """Fit all people, each into a folder in --out: person-1, person-2, ... from left to right as they appear."""
    shape: Annotated[Path | None, shown("PATH", "estimated from the clip")] = None
    """The person's shape, if it is known: the folder of a result, a project, or an npz or JSON file with betas."""
    overwrite: bool = False
    """Write into a folder that contains other files too."""
    overlay: bool = True
    """Write overlay.mp4: phase 1 and the final fit side by side."""
    threads: Annotated[int, shown("N", "one for each core")] = 0
    """Number of threads."""
    json: JsonLines = False
    clip: ClipOptions = field(default_factory=ClipOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    views: ViewOptions = field(default_factory=ViewOptions)
    body: BodyOptions = field(default_factory=BodyOptions)
    begin: StartOptions = field(default_factory=StartOptions)
    method: MethodOptions = field(default_factory=MethodOptions)


@dataclass(frozen=True, kw_only=True)
class NewOptions:
    """Make a project of a clip, in which keypoints are corrected and fits are stored.

    A project is a folder. It links to the video unless --copy-video is given.
    """

    video: Video = None
    """A video file, a folder of images, or a folder in SMPLify-X layout (images/ and keypoints/ inside)."""
    keypoints: KeypointFiles = None
    """OpenPose JSON (a folder, or one file), COCO-WholeBody JSON, or a .pose file. none: a project without
    keypoints."""
    out: Annotated[Path | None, shown("DIR", "the clip's name with .tcfit, in this folder")] = None
    """Folder of the new project. It must not exist yet."""
    people: Annotated[Literal["all"] | None, shown("all", "one person")] = None
    """Make a project of each person: a folder with people.json and the projects person-1, person-2, ..."""
    height: Annotated[str | None, shown("CM", "unknown")] = None
    """The person's height in centimetres, without shoes; stored in the project. It determines shape and distance."""
    copy_video: bool = False
    """Copy the video or images into the project, so that it can be moved to another computer."""
    clip: ClipOptions = field(default_factory=ClipOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    views: ViewOptions = field(default_factory=ViewOptions)
    truth: ReferenceOptions = field(default_factory=ReferenceOptions)


@dataclass(frozen=True, kw_only=True)
class ServerOptions:
    """Address of the review."""

    host: Annotated[str, shown("NAME", "127.0.0.1, this computer alone")] = "127.0.0.1"
    """Address to listen on. Anything but the default makes the app reachable from other computers."""
    port: Annotated[int, shown("N", "8080, or the next free one")] = 8080
    """Port; 0: any free port."""
    browser: bool = True
    """Open the link in a browser."""
    files: Annotated[Path | None, shown("DIR", "any folder, only for browsers on this computer")] = None
    """Folder whose files can be opened in the page, from other computers too (videos, results, models)."""
    password_file: Annotated[Path | None, shown("FILE", "none: each browser needs a link")] = None
    """File whose first line is a password for all browsers, of 12 characters or more."""
    public: Annotated[str | None, shown("URL", "none")] = None
    """Address of the review behind a proxy, such as https://fits.example.org."""


@dataclass(frozen=True, kw_only=True)
class ReviewOptions:
    """Open a project in the browser: see its fits, correct keypoints, fit again, compare.

    For a video, its project is opened, or made if it is missing.
    """

    video: Annotated[
        Positional[Path | None],
        arg(metavar="PROJECT|VIDEO|FOLDER", help_behavior_hint="(required without --keypoints)"),
    ] = None
    """A project, a result of `tcfit fit`, a video or images, or a folder of any of these, which are listed."""
    keypoints: KeypointFiles = None
    """For a new project. OpenPose JSON (a folder, or one file), COCO-WholeBody JSON, or a .pose file. none: a project
    without keypoints."""
    out: Annotated[Path | None, shown("DIR", "the clip's name with .tcfit, in this folder")] = None
    """Folder of a new project."""
    height: Annotated[str | None, shown("CM", "that of the project")] = None
    """The person's height in centimetres, without shoes; stored in the project. It determines shape and distance."""
    copy_video: bool = False
    """For a new project: copy the video or images into it."""
    read_only: bool = False
    """Open read-only."""
    fit: bool = False
    """Start a fit immediately if the project has none."""
    models: ModelsFolder = None
    clip: ClipOptions = field(default_factory=ClipOptions)
    """For a new project: part of the clip, and how its files are read."""
    camera: CameraOptions = field(default_factory=CameraOptions)
    """For a new project: the camera. --focal-length, --fov and --focal-length-35mm exclude each other."""
    views: ViewOptions = field(default_factory=ViewOptions)
    truth: ReferenceOptions = field(default_factory=ReferenceOptions)
    server: ServerOptions = field(default_factory=ServerOptions)


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Open the demo clip in the browser while it is being fitted."""

    out: Annotated[Path | None, shown("DIR", "tcfit-demo.tcfit")] = None
    """Folder of the project. An existing one is opened unchanged."""
    server: ServerOptions = field(default_factory=ServerOptions)
    threads: Annotated[int, shown("N", "one for each core")] = 0
    """Number of threads."""
    method: MethodOptions = field(default_factory=MethodOptions)


def fit_config(options: MethodOptions) -> FitConfig:
    """The configuration: preset, then file, then single settings. Raises InputError for settings that are unknown,
    wrong, given twice, or contradictory."""
    _, config = _of_preset(options)
    seen: dict[str, str] = {}
    for origin, name, text in _given(options):
        if name in seen:
            raise InputError(f"{name} is given twice, by {seen[name]} and {origin}; give it once.")
        config = changed(config, {name: text}, origin=origin, texts=True)
        seen[name] = origin
    check(config)
    return config


def height_of(options: NewOptions | ReviewOptions) -> float | None:
    """The given height in centimetres. Raises InputError if it is not a person's."""
    if options.height is None:
        return None
    return changed(PRESETS[DEFAULT_PRESET], {"height": options.height}, origin="--height", texts=True).height


def camera_for(camera: CameraOptions, method: MethodOptions | None = None) -> CameraOptions:
    """The camera options, with the image's diagonal as focal length if none is given and the preset follows a paper.
    Raises InputError if the configuration cannot be read."""
    return camera if method is None else camera.for_preset(_of_preset(method)[0])


def _of_preset(options: MethodOptions) -> tuple[str, FitConfig]:
    """The preset's name, and its configuration with the changes of --config."""
    if options.config is not None:
        return read_named(options.config, preset_name=options.preset)
    name = options.preset or DEFAULT_PRESET
    return name, preset(name)


def _given(options: MethodOptions) -> Iterator[tuple[str, str, str]]:
    """Option, setting and value of each given setting."""
    for option, name in SHORTCUTS.items():
        if (text := getattr(options, option)) is not None:
            yield "--" + option.replace("_", "-"), name, text
    for assignment in options.set:
        name, equals, text = (part.strip() for part in assignment.partition("="))
        if name not in settings():
            raise InputError(f"--set: {unknown(name)}")
        if not equals:
            raise InputError(f"--set {assignment}: expected {name}=VALUE, {settings()[name].expected}.")
        yield "--set", name, text
