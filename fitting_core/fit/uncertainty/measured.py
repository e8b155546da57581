"""How much wider than the deviations of the normal equations the errors of the motion suite's tuning half are.

Written by `python -m benchmarks.error_bars --half tuning --write`, with preset tcfit and the free body.
"""

OF_JOINTS = {
    "hip": ((11.2, 0.019), (10.9, 0.0132)),
    "spine": ((17.7, 1.29e-09), (15.9, 0.00302)),
    "knee": ((12.6, 0.021), (12.5, 0.00276)),
    "ankle": ((11.9, 0.0804), (16.3, 0.00986)),
    "foot": ((8.73, 0.112), (15.8, 0.0166)),
    "neck": ((17.3, 2.76e-09), (11.6, 0.0183)),
    "collar": ((18.0, 3.79e-17), (11.4, 0.0161)),
    "head": ((19.1, 7.99e-22), (11.8, 0.0182)),
    "shoulder": ((14.0, 0.0152), (9.6, 0.0147)),
    "elbow": ((5.57, 0.0571), (8.88, 0.0215)),
    "wrist": ((6.03, 0.104), (12.5, 0.0163)),
}
"""By part of the body: factor and least error in metres, along the ray and across it."""
OF_ANGLES = {
    "hip": (7.53, 10.4),
    "knee": (8.6, 9.15),
    "elbow": (9.22, 14.8),
}
"""By joint: factor and least error in degrees."""
