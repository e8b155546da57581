"""The options of `tcfit fit`, and how they become a FitConfig. Imports nothing heavy."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructTypeInfo

from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.config.settings import changed, check, settings, unknown
from fitting_core.config.toml import preset, read_named
from fitting_core.detect.detectors import DEFAULT, DETECTORS
from fitting_core.errors import InputError


def shown(metavar: str, default: str, text: str | None = None) -> Any:
    """How an option that can be left out shows in the help; its text is else that of the field."""
    return arg(metavar=metavar, help=text, help_behavior_hint=f"(default: {default})")


JsonLines = Annotated[bool, arg(help="Tell programs what happens: a JSON object for each line of the standard output.")]
ModelsFolder = Annotated[
    Path | None, shown("DIR", "see tcfit models", "Folder with body models, which alone is searched then.")
]
RunName = Annotated[str | None, shown("NAME", "the newest", "Which run of a project: its name or number.")]
Phase = Annotated[
    Literal[1, 2, 3] | None,
    shown("{1,2,3}", "the last", "1: each frame on its own; 2: with one shape; 3: consistent over time."),
]


@dataclass(frozen=True, kw_only=True)
class ReferenceOptions:
    """What fits are compared with, where something is known; kept in the project."""

    reference: Annotated[Path | None, shown("PATH", "none")] = None
    """3D points (npz, TRC, C3D), an AMASS-style npz, a truth.npz, or another fit.npz."""
    reference_camera: Annotated[Path | None, shown("FILE.npz", "as the clip's camera is calibrated")] = None
    """The clip's camera in the reference's world: R and t, with x_camera = R x + t. Without, only form is compared."""
    reference_first_frame: Annotated[int | None, shown("N", "as it says, or 0")] = None
    """Number in the video of the reference's first frame, where it was cut and does not say so."""


NO_KEYPOINTS = Path("none")
"""What --keypoints says for a project of the video alone."""
DETECTOR_NAMES = f"{', '.join(DETECTORS)}, or an ONNX model of the RTMPose family; `tcfit detect --list` says more."

SHORTCUTS = {
    "temporal_weight": "temporal.weight",
    "window_size": "temporal.window_size",
    "shape_sample": "shape_sample.size",
    "height": "height",
    "device": "device",
}
"""Options for the settings that are changed most, by the name of the option."""
REMOVED = {
    "solver": "solver",
    "pose_prior": "pose_prior",
    "temporal": "temporal.mode",
    "temporal_space": "temporal.space",
    "shape_strategy": "shape_sample.strategy",
    "seed": "shape_sample.seed",
    "silhouettes": "silhouettes",
    "start_deviation": "start_deviation",
    "precision": "precision",
}
"""Options that earlier versions had for single settings; lists of clips may still have these columns."""


def refuse_removed(arguments: Sequence[str]) -> None:
    """Raise InputError if a command line has an option of REMOVED; the message names its replacement."""
    for argument in arguments:
        option, _, text = argument.partition("=")
        if option.startswith("--") and (setting := REMOVED.get(option[2:].replace("-", "_"))):
            raise InputError(f"{option} is not an option any more. Use --set {setting}={text or 'VALUE'}.")


def _shortcut(option: str, text: str = "") -> Any:
    """How an option of SHORTCUTS shows in the help; its text is the setting's own, if it has one."""
    setting = settings()[SHORTCUTS[option]]
    return shown(setting.metavar, "the preset's", text or setting.doc)


HINTS: dict[type, dict[str, Any]] = {
    ClipOptions: {
        "detector": shown("NAME", DEFAULT, f"What finds keypoints in the video where none are given: {DETECTOR_NAMES}"),
        "person": shown("N", "follow the most prominent"),
        "first_frame": shown("N", "the first"),
        "last_frame": shown("N", "the last"),
        "frame_rate": shown("FPS", "the video's, or 30"),
        "keypoint_scale": arg(metavar="{auto,pixels,0..1,-1..1}"),
        "image_size": shown("W H", "the video's, or guessed from the keypoints"),
    },
    CameraOptions: {
        "focal_length": shown("PX|auto|diagonal", "auto; with the presets paper and smplifyx diagonal"),
        "fov": shown("DEGREES", "not given"),
        "focal_length_35mm": shown("MM", "not given"),
        "center": shown("X Y", "the image's centre"),
        "camera": shown("FILE", "none"),
        "camera_name": shown("NAME", "the only one"),
        "camera_unit": shown("METRES", "1, estimated if it moves"),
        "camera_up": shown("{x,y,z,-x,-y,-z}", "as the file has it; z for TOML"),
    },
}
"""How the library's options show in the help, by their names; their texts are those of the library."""


def registry_of_hints() -> ConstructorRegistry:
    """What shows the library's options with their hints while a command line is read."""
    registry, asked = ConstructorRegistry(), set[type]()

    @registry.struct_rule
    def rule(info: StructTypeInfo) -> StructConstructorSpec | None:
        kind = info.type if isinstance(info.type, type) else type(None)
        if kind not in HINTS or kind in asked:
            return None
        asked.add(kind)  # the next rule is asked, which reads any dataclass
        try:
            spec = ConstructorRegistry.get_struct_spec(info)
        finally:
            asked.remove(kind)
        assert isinstance(spec, StructConstructorSpec)
        fields = (replace(f, type=Annotated[f.type, HINTS[kind][f.name]]) for f in spec.fields)
        return replace(spec, fields=tuple(fields))

    return registry


@dataclass(frozen=True, kw_only=True)
class StartOptions:
    """A result of another system for this clip, with which phase 1 begins; frames that it lacks are fitted as usual."""

    start: Annotated[Path | None, shown("RESULT", "none")] = None
    """A result of GVHMR, GEM, WHAM, PromptHMR, 4D-Humans or SAM 3D Body, SMPLify-X's output folder, an npz of SMPL-X
    or AMASS, or a fit of tcfit. The content tells which."""
    start_person: Annotated[int | None, shown("N", "who follows the keypoints; of SMPLify-X 0")] = None
    """Of several people in it, as it numbers them."""
    start_first_frame: Annotated[int | None, shown("N", "as its files are numbered, or the clip's first")] = None
    """Number in the video of its first frame."""


@dataclass(frozen=True, kw_only=True)
class BodyOptions:
    """The body model; `tcfit models` lists those found."""

    body_model: Annotated[str, arg(metavar="{smplx,smplh,smpl}|PATH")] = "smplx"
    """Its kind, or a model file."""
    models: ModelsFolder = None
    gender: Annotated[str, arg(metavar="{neutral,male,female,child}")] = "neutral"
    """Gender of the body model; child: the free body of a boy or girl of about 2 to 13 years."""


@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """The method. The preset counts least, then the file of --config, then these options."""

    preset: Annotated[
        str | None, shown("{" + ",".join(PRESETS) + "}", f"that of the --config file, or {DEFAULT_PRESET}")
    ] = None
    """smplifyx: phase 1 as SMPLify-X; paper: as the paper has it; tcfit: what measures best."""
    config: Annotated[Path | None, shown("FILE.toml", "none")] = None
    """Settings in TOML; `tcfit settings` prints such a file with all of them."""
    temporal_weight: Annotated[str | None, _shortcut("temporal_weight")] = None
    window_size: Annotated[str | None, _shortcut("window_size", "Frames of a sliding window.")] = None
    shape_sample: Annotated[str | None, _shortcut("shape_sample", "Frames that find the shared shape.")] = None
    height: Annotated[
        str | None, _shortcut("height", "The person's height in centimetres; the distance follows it.")
    ] = None
    device: Annotated[str | None, _shortcut("device", "Where torch computes: cpu, cuda, cuda:1, mps.")] = None
    set: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE", help_behavior_hint="(repeatable)")] = ()
    """Any setting that `tcfit settings` lists, by its dotted name: --set weights.body_pose=404,404,57.4,4.78,4.78"""


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Fit the body to a clip: every frame on its own, one shape, then consistency over time.

    A video is enough: keypoints that are not given are found in it, once. The --out folder receives fit.npz (SMPL-X
    parameters of both fits), summary.json and, with a video, overlay.mp4. Ctrl-C keeps the phases that have finished.
    """

    video: Annotated[
        Positional[Path | None], arg(metavar="VIDEO", help_behavior_hint="(required without --keypoints)")
    ] = None
    """A video file, a folder of images, or a folder in SMPLify-X layout (images/ and keypoints/ inside)."""
    keypoints: Annotated[Path | None, shown("PATH", "keypoints/ of the SMPLify-X layout, or found in the video")] = None
    """OpenPose JSON (a folder, or one file), COCO-WholeBody JSON, or a .pose file."""
    out: Annotated[Path, arg(metavar="DIR")]
    """Folder for the result. A result that lies there is replaced."""
    people: Annotated[Literal["all"] | None, shown("all", "one person")] = None
    """Fit everybody, each into a folder of --out: person-1, person-2, ... as they appear, from left to right."""
    shape: Annotated[Path | None, shown("PATH", "found from the clip")] = None
    """The person's shape, where it is known: the folder of a result, a project, or an npz or JSON file with betas."""
    overwrite: bool = False
    """Write into a folder that holds other files too."""
    overlay: bool = True
    """Write overlay.mp4: phase 1 and the final fit side by side."""
    threads: Annotated[int, shown("N", "one for each core")] = 0
    """Threads on which the frames of a fit are shared out."""
    json: JsonLines = False
    clip: ClipOptions = field(default_factory=ClipOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    body: BodyOptions = field(default_factory=BodyOptions)
    begin: StartOptions = field(default_factory=StartOptions)
    method: MethodOptions = field(default_factory=MethodOptions)


@dataclass(frozen=True, kw_only=True)
class NewOptions:
    """Make a project of a clip, in which its keypoints are corrected and its fits kept.

    A project is a folder. The video stays where it is unless --copy-video is given.
    """

    video: Annotated[
        Positional[Path | None], arg(metavar="VIDEO", help_behavior_hint="(required without --keypoints)")
    ] = None
    """A video file, a folder of images, a folder in SMPLify-X layout (images/ and keypoints/ inside), or a project that
    `tcfit export --formats project` packed."""
    keypoints: Annotated[Path | None, shown("PATH", "keypoints/ of the SMPLify-X layout, or found in the video")] = None
    """OpenPose JSON (a folder, or one file), COCO-WholeBody JSON, or a .pose file. none: a project of the
    video alone."""
    out: Annotated[Path | None, shown("DIR", "the clip's name with .tcfit, in this folder")] = None
    """The project's folder, which may not exist yet."""
    people: Annotated[Literal["all"] | None, shown("all", "one person")] = None
    """Make a project of everybody: a folder with people.json and the projects person-1, person-2, ..."""
    height: Annotated[str | None, shown("CM", "not known")] = None
    """The person's height in centimetres, without shoes, which the project keeps: shape and distance follow it."""
    copy_video: bool = False
    """Copy the video or images into the project, so that it can be given to others."""
    clip: ClipOptions = field(default_factory=ClipOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    truth: ReferenceOptions = field(default_factory=ReferenceOptions)


@dataclass(frozen=True, kw_only=True)
class ServerOptions:
    """Where the review is served."""

    host: Annotated[str, shown("NAME", "127.0.0.1, this computer alone")] = "127.0.0.1"
    """Name or address of this computer to listen at; others than the default let other computers in."""
    port: Annotated[int, shown("N", "8080, or the next free one")] = 8080
    """0 takes any."""
    browser: bool = True
    """Open the link in a browser, where there is one."""
    files: Annotated[Path | None, shown("DIR", "any, for browsers on this computer alone")] = None
    """Folder whose files may be named in the page (videos, results, models), by browsers on other computers too."""
    password_file: Annotated[Path | None, shown("FILE", "none: each browser needs a link")] = None
    """File whose first line is a password of 12 characters or more, which lets in any number of browsers."""
    public: Annotated[str | None, shown("URL", "none")] = None
    """Address under which a proxy offers the review, such as https://fits.example.org."""


@dataclass(frozen=True, kw_only=True)
class ReviewOptions:
    """Open a project in the browser: see its fits, correct keypoints, fit again, compare.

    With a video instead of a project, its project is made first, or opened if it was made before of the same clip.
    """

    video: Annotated[
        Positional[Path | None], arg(metavar="PROJECT|VIDEO", help_behavior_hint="(required without --keypoints)")
    ] = None
    """A project's folder, or that of a clip's people; a result of `tcfit fit`; or what `tcfit new` takes."""
    keypoints: Annotated[Path | None, shown("PATH", "keypoints/ of the SMPLify-X layout, or found in the video")] = None
    """For a new project. OpenPose JSON (a folder, or one file), COCO-WholeBody JSON, or a .pose file. none: a project
    of the video alone."""
    out: Annotated[Path | None, shown("DIR", "the clip's name with .tcfit, in this folder")] = None
    """For a new project: its folder."""
    height: Annotated[str | None, shown("CM", "as the project has it")] = None
    """The person's height in centimetres, without shoes, which the project keeps: shape and distance follow it."""
    copy_video: bool = False
    """For a new project: copy the video or images into it."""
    read_only: bool = False
    """Only look."""
    fit: bool = False
    """Start a fit at once if the project has none."""
    models: ModelsFolder = None
    clip: ClipOptions = field(default_factory=ClipOptions)
    """For a new project: which part of the clip, and how its files are read."""
    camera: CameraOptions = field(default_factory=CameraOptions)
    """For a new project: the camera. Give at most one of the first three."""
    truth: ReferenceOptions = field(default_factory=ReferenceOptions)
    server: ServerOptions = field(default_factory=ServerOptions)


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Open the demo clip in the browser with its fit coming in.

    With --no-review it is fitted here, the result written to files and compared with the truth.
    """

    out: Annotated[Path | None, shown("DIR", "tcfit-demo.tcfit; with --no-review tcfit-demo")] = None
    """Folder of the project, or for the result. A project that lies there is opened as it is."""
    review: bool = True
    """Open the review; else fit in the terminal."""
    server: ServerOptions = field(default_factory=ServerOptions)
    overwrite: bool = False
    """With --no-review: write into a folder that holds other files too."""
    overlay: bool = True
    """With --no-review: write overlay.mp4, phase 1 and the final fit side by side."""
    threads: Annotated[int, shown("N", "one for each core")] = 0
    """Threads on which the frames of a fit are shared out."""
    method: MethodOptions = field(default_factory=MethodOptions)


def fit_config(options: MethodOptions) -> FitConfig:
    """The configuration that the options ask for: preset, then file, then single settings. Raises InputError if there
    is an unknown or wrong setting, one that is given twice, or two that cannot be together."""
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
    """The person's height in centimetres, where it is said. Raises InputError if nobody has it."""
    if options.height is None:
        return None
    return changed(PRESETS[DEFAULT_PRESET], {"height": options.height}, origin="--height", texts=True).height


def camera_for(camera: CameraOptions, method: MethodOptions | None = None) -> CameraOptions:
    """With the image's diagonal where no focal length is given and the preset follows a paper. Raises InputError if the
    method's configuration cannot be read."""
    return camera if method is None else camera.for_preset(_of_preset(method)[0])


def _of_preset(options: MethodOptions) -> tuple[str, FitConfig]:
    """The preset that the options start from, and it with what the file of --config changes."""
    if options.config is not None:
        return read_named(options.config, preset_name=options.preset)
    name = options.preset or DEFAULT_PRESET
    return name, preset(name)


def _given(options: MethodOptions) -> Iterator[tuple[str, str, str]]:
    """Option, setting and value of each setting on the command line."""
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
