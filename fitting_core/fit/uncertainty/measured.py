"""How much wider than the deviations of the normal equations the errors of the motion suite's tuning half are.

Written by `python -m benchmarks.error_bars --half tuning --write`, with preset tcfit and the free body.
"""

OF_JOINTS = {
    "hip": ((10.8, 0.0185), (10.4, 0.0129)),
    "spine": ((17.1, 0.0), (15.3, 0.0033)),
    "knee": ((12.3, 0.0208), (12.2, 0.0037)),
    "ankle": ((11.8, 0.0779), (15.9, 0.0088)),
    "foot": ((8.97, 0.1066), (15.5, 0.0161)),
    "neck": ((16.8, 0.0), (11.2, 0.018)),
    "collar": ((17.4, 0.0), (11.2, 0.0156)),
    "head": ((18.4, 0.0), (11.4, 0.0179)),
    "shoulder": ((13.6, 0.0136), (9.38, 0.014)),
    "elbow": ((5.3, 0.0558), (8.6, 0.0209)),
    "wrist": ((6.24, 0.1004), (12.1, 0.0158)),
}
"""By part of the body: factor and least error in metres, along the ray and across it."""
OF_ANGLES = {
    "hip": (7.35, 10.1237),
    "knee": (8.33, 9.0118),
    "elbow": (8.83, 14.425),
}
"""By joint: factor and least error in degrees."""
