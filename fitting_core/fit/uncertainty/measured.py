"""Ratio of the motion suite's errors (tuning half) to the normal equations' deviations, and what real clips add.

Written by `python -m benchmarks.error_bars --half tuning --write`, and `--half real --write` after it, with preset
tcfit and the free body.
"""

OF_JOINTS = {
    "hip": ((10.9, 0.0183), (10.5, 0.0127)),
    "spine": ((17.0, 0.0), (15.3, 0.0032)),
    "knee": ((12.4, 0.0211), (12.1, 0.0034)),
    "ankle": ((11.6, 0.0798), (15.9, 0.0089)),
    "foot": ((8.86, 0.1078), (15.6, 0.0161)),
    "neck": ((16.7, 0.0), (11.2, 0.018)),
    "collar": ((17.5, 0.0), (11.1, 0.0156)),
    "head": ((18.5, 0.0), (11.3, 0.018)),
    "shoulder": ((13.4, 0.0139), (9.47, 0.0139)),
    "elbow": ((7.57, 0.0454), (8.67, 0.0204)),
    "wrist": ((14.4, 0.0485), (12.2, 0.0155)),
}
"""By part of the body: factor and least error in metres, along the ray and across it."""
OF_ANGLES = {
    "hip_flexion": (7.42, 10.1721),
    "knee_flexion": (8.35, 8.7651),
    "elbow_flexion": (9.14, 12.5207),
    "shoulder_elevation": (6.63, 7.4809),
    "ankle_dorsiflexion": (1.21, 13.9663),
    "lumbar_extension": (0.0, 18.3507),
    "lumbar_bending": (3.71, 6.9752),
    "lumbar_rotation": (0.0, 10.0661),
}
"""By angle: factor and least error in degrees."""
LASTING = {
    "hip": (0.0, 0.0),
    "knee": (0.0, 0.004),
    "ankle": (0.0, 0.011),
    "shoulder": (0.027, 0.0),
    "elbow": (0.0, 0.012),
    "wrist": (0.0, 0.004),
}
"""By part of the body: metres by which real clips are off beyond that, along the ray and across it."""
LIKE = {"spine": "hip", "neck": "shoulder", "collar": "shoulder", "head": "shoulder", "foot": "ankle"}
"""Parts that no real clip has a truth for, and those whose lasting error they take."""
