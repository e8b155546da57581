"""Everything that can be set about a fit, and the presets as values. Imports no torch: the command line stays quick."""

from dataclasses import dataclass, field, replace
from typing import Literal

from fitting_core.config.weights import SMPLIFYX, TCFIT, Weights

POSE_PRIORS = ("axis_angle", "relaxed", "tcfit", "vposer")
"""Names of pose priors; `priors.pose.PRIORS` says what they are."""


@dataclass(frozen=True, kw_only=True)
class ShapeSample:
    """Phase 2: the frames that find the shared shape."""

    size: int = 15
    strategy: Literal["random", "confident", "coverage"] = "random"
    """Random with a seed; highest mean confidence; or chosen so that every body part is seen."""
    seed: int = 0
    stages: tuple[int, ...] = (1, 2, 3, 4, 5)
    """Which of the five stages run, in order."""


@dataclass(frozen=True, kw_only=True)
class Temporal:
    """Phase 3: consistency over time."""

    mode: Literal["sliding_window", "global"] = "sliding_window"
    """The paper's sliding window, or all frames at once (cost linear in the length)."""
    weight: float = 100.0
    """w_T; its square multiplies squared metres."""
    reference_rate: float | None = None
    """Frame rate to which w_T belongs: it then scales with the square of the clip's, as E_T's differences shrink, so
    that the same motion costs the same. None: w_T as it is."""
    space: Literal["body", "camera"] = "body"
    """Joints without the camera translation, as the paper writes it, or with it."""
    window_size: int = 7
    stages: tuple[int, ...] = (1, 2, 3, 4, 5)
    """Which of the five stages run, in order."""


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """When a solver stops."""

    stage_tolerance: float = 1e-4
    """lm: relative decrease under which a stage ends that another one follows."""
    final_tolerance: float = 1e-6
    """lm: the same for the last stage of a phase."""
    sequence_tolerance: float = 3e-5
    """lm: the same where frames are coupled (phases 2 and 3): below it one frame at a time wanders along its valley,
    0.1 % of the cost in 50 more steps."""
    camera_tolerance: float = 1e-6
    """lm: the same for the camera step of phase 1."""
    iterations: int = 60
    """lm: most steps in a stage."""
    rounds: int = 30
    """lbfgs: most rounds of 30 inner iterations."""
    relative_tolerance: float = 1e-9
    """lbfgs: relative change of a round under which it ends."""


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    """A whole fit. A preset is a value of this type; the command line and a TOML file change single fields."""

    weights: Weights = field(default_factory=Weights)
    shape_sample: ShapeSample = field(default_factory=ShapeSample)
    temporal: Temporal = field(default_factory=Temporal)
    settings: SolverSettings = field(default_factory=SolverSettings)
    solver: Literal["lm", "lbfgs"] = "lm"
    pose_prior: str = "tcfit"
    """What is held to be a likely pose: L2 around the T-pose (axis_angle) or around standing at ease (relaxed); a
    latent space learned from motion capture (tcfit; vposer, once `tcfit models add` added it); or the path of VPoser or
    of a pose prior's npz."""
    hand_components: int = 12
    """Principal components of each hand; 45 for full axis-angle."""
    height: float | None = None
    """Standing height of the person in centimetres, without shoes; phase 2 scales body and distance to it. None: not
    known, a likely one."""
    robust_pixels: float = 100.0
    """rho of the Geman-McClure function for body keypoints, in pixels."""
    robust_pixels_fine: float = 100.0
    """The same for hands and face."""
    robust_deviations: float = 2.0
    """rho for relative positions, in standard deviations of what the lifter says."""
    start_deviation: float | None = None
    """With a given start, how near the fit is held to it: standard deviation in metres of where its body keypoints lie
    relative to the pelvis. None: the fit only begins with it."""
    robust_at_height: float | None = None
    """Image height to which both rho belong; they scale with the clip's own. None: pixels as they are."""
    keypoint_noise: Literal["auto", "openpose", "mediapipe", "coco-wholebody", "equal"] = "equal"
    """By whose noise the data term weighs keypoints: that of the detector that found them (auto), or of the one named.
    equal: all weigh the same, as OpenPose's do in any case; it measures best (see keypoint_noise.py)."""
    neck_weight: float = 0.0
    """Factor of the neck keypoint in the stages; the camera step always uses it."""
    hip_weight: float = 0.0
    """Factor of both hip keypoints in the stages; the camera step always uses them."""
    one_sided_cut_off: bool = False
    """Take detections where the image cuts a person off as "there or farther out" (see observations.py)."""
    unswap_sides: bool = False
    """Undo swaps of left and right limbs that last for some frames (see observations.py)."""
    yaws: Literal["side_view", "four"] = "side_view"
    """Starting orientations of phase 1: turned by 180 degrees when seen from the side, or four quarter turns."""
    key_frames_every: int = 1
    """Phase 1: of how many frames one is a key frame and goes through the five stages. The others start between key
    frames. 1: every frame."""
    widened_start: bool = True
    """Phase 1: where hands and face begin to count, try a way with a wider robust function too, and keep the better."""
    relay_rounds: int = 0
    """Phase 1: rounds in which each frame restarts from its neighbours' solutions and keeps the better."""
    curled_hands: bool = False
    """Phase 1: start stage 5 with hands halfway to a fist instead of open."""
    limb_flips: bool = False
    """Phase 1: restart key frames with arms and legs mirrored in depth where the lifter has them elsewhere, one at a
    time, and keep the best."""
    camera_frozen: bool = False
    """Phase 1: keep the translation of the camera step, as SMPLify-X does."""
    silhouettes: bool = False
    """Phase 2: find the shape with what the person covers of the image too, where it is known (see outlines.py)."""
    last_phase: Literal[1, 2, 3] = 3
    """Stop after this phase."""
    precision: Literal["float64", "float32"] = "float64"
    device: str = "cpu"


_PAPER = FitConfig()

PRESETS: dict[str, FitConfig] = {
    "smplifyx": replace(_PAPER, weights=SMPLIFYX, camera_frozen=True),
    "paper": _PAPER,
    "tcfit": replace(
        _PAPER,
        weights=TCFIT,
        hip_weight=1.0,
        robust_pixels_fine=15.0,
        start_deviation=0.03,
        robust_at_height=1000.0,
        one_sided_cut_off=True,
        unswap_sides=True,
        yaws="four",
        # Key frames, a direct start and looser tolerances take a third of the time (gebaerden 32.9 -> 12.2 CPU s), at a
        # lower cost (2462 -> 2377), and are no worse on the suite (evaluation/RESULTS/speed.md).
        key_frames_every=4,
        widened_start=False,
        settings=SolverSettings(camera_tolerance=1e-3, sequence_tolerance=3e-4),
        # Only neighbours that changed are tried again, so more rounds cost no more time. After 3 of them a bad stretch
        # of 14 frames was left: vertex-to-surface 3.67 -> 2.32 cm (suite, complex_1).
        relay_rounds=20,
        # 2.82 -> 2.32 and 2.72 -> 2.31 cm (suite, complex_2, complex_6). The balancing clips come out the same.
        limb_flips=True,
        curled_hands=True,
        silhouettes=True,
        shape_sample=ShapeSample(strategy="coverage", stages=(5,)),
        temporal=Temporal(mode="global", space="camera", stages=(5,), reference_rate=25.0),
    ),
}
"""smplifyx: phase 1 as SMPLify-X has it. paper: faithful to the paper. tcfit: what measures best; the default."""
DEFAULT_PRESET = "tcfit"


def fits_as_smplifyx(config: FitConfig) -> bool:
    """Whether its first phase is what SMPLify-X does: preset smplifyx, with the term of self-collision or without."""
    known = PRESETS["smplifyx"]
    # What later phases do, when the fit stops, and what it is computed with change nothing of what phase 1 is.
    beside = ("shape_sample", "temporal", "settings", "solver", "last_phase", "precision", "device")
    same = replace(config, **{name: getattr(known, name) for name in beside})
    return without_collisions(same) == without_collisions(known)


def without_collisions(config: FitConfig) -> FitConfig:
    """The same without the term of self-collision, which takes most of the time of the presets that have it."""
    return replace(config, weights=replace(config.weights, collision=(0.0,) * len(config.weights.collision)))
