"""Read fit.npz with NumPy alone: python examples/read_fit.py walk-fit/fit.npz"""

import sys

import numpy as np

WRIST, ELBOW, SHOULDER = 21, 19, 17  # right; SMPL-X's order of joints


def main(path: str) -> None:
    fit = np.load(path, allow_pickle=False)
    joints, rate = fit["joints"], float(fit["mocap_frame_rate"])  # metres; x right, y down, z away from the camera

    speed = np.linalg.norm(np.diff(joints[:, WRIST], axis=0), axis=1) * rate
    upper, lower = joints[:, ELBOW] - joints[:, SHOULDER], joints[:, WRIST] - joints[:, ELBOW]
    cosine = (upper * lower).sum(1) / np.linalg.norm(upper, axis=1) / np.linalg.norm(lower, axis=1)
    print(f"{len(joints)} frames at {rate:g} per second, from frame {fit['frames'][0]} of the video")
    print(f"right wrist: up to {speed.max():.2f} m/s; right elbow bent by {np.degrees(np.arccos(cosine)).mean():.0f}°")
    print(f"distance of the pelvis from the camera: {joints[:, 0, 2].mean():.2f} m")

    seen = fit["observed"][:, ELBOW].mean()  # elsewhere the pose comes from the prior and the neighbouring frames
    print(f"the picture shows how the right elbow bends in {seen:.0%} of the frames")
    if "joint_error_bars" in fit:
        along, across = 1e3 * np.median(fit["joint_error_bars"][:, WRIST], axis=0)
        print(f"error bar of the right wrist: {along:.0f} mm along the line of sight, {across:.0f} mm across it")
    print(f"focal length {fit['camera_focal'][0]:.0f} px: {fit['camera_source']}")


if __name__ == "__main__":
    main(*sys.argv[1:])
