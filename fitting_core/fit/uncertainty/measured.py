"""Ratio of the motion suite's errors (tuning half) to the normal equations' deviations, and what real clips add.

Written by `python -m benchmarks.error_bars --half tuning --write`, and `--half real --write` after it, with preset
tcfit and the free body.
"""

OF_JOINTS = {
    "hip": ((11.6, 0.0172), (10.5, 0.013)),
    "spine": ((17.7, 0.0), (15.4, 0.0011)),
    "knee": ((12.3, 0.0203), (12.2, 0.0)),
    "ankle": ((12.1, 0.0701), (15.7, 0.0078)),
    "foot": ((9.9, 0.1003), (15.4, 0.0143)),
    "neck": ((17.2, 0.0), (11.8, 0.0157)),
    "collar": ((18.0, 0.0), (12.1, 0.0129)),
    "head": ((18.8, 0.0), (12.0, 0.0151)),
    "shoulder": ((13.7, 0.0175), (10.5, 0.0117)),
    "elbow": ((7.89, 0.0462), (8.9, 0.0197)),
    "wrist": ((15.4, 0.0422), (12.5, 0.0128)),
}
"""By part of the body: factor and least error in metres, along the ray and across it."""
OF_ANGLES = {
    "hip_flexion": (7.72, 9.8167),
    "knee_flexion": (8.57, 7.888),
    "elbow_flexion": (9.78, 11.3194),
    "shoulder_elevation": (6.67, 7.9555),
    "ankle_dorsiflexion": (2.05, 13.0367),
    "lumbar_extension": (0.0, 18.4016),
    "lumbar_bending": (4.64, 6.607),
    "lumbar_rotation": (0.0, 10.2505),
}
"""By angle: factor and least error in degrees."""
LASTING = {
    "hip": (0.0, 0.0),
    "knee": (0.0, 0.0),
    "ankle": (0.0, 0.018),
    "shoulder": (0.022, 0.0),
    "elbow": (0.0, 0.013),
    "wrist": (0.0, 0.008),
}
"""By part of the body: metres by which real clips are off beyond that, along the ray and across it."""
LIKE = {"spine": "hip", "neck": "shoulder", "collar": "shoulder", "head": "shoulder", "foot": "ankle"}
"""Parts that no real clip has a truth for, and those whose lasting error they take."""
