"""Shows what retargeting does: source skeletons beside the bodies that they became, and how far bones differ.

    python -m fitting_core.priors.train.check_retarget DATA SHEET.png
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.body.files import load_body
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT
from fitting_core.body.params import BodyParams
from fitting_core.body.registry import FREE_FOLDER, find_body
from fitting_core.errors import InputError
from fitting_core.priors.sheets import Cell, View, beside, body_picture, skeleton_picture, view_of, write_sheet
from fitting_core.priors.train.mocap import SourceMotion, read_motions
from fitting_core.priors.train.retarget import RIGS, plausible, retarget


def main() -> None:
    import argparse
    a = argparse.ArgumentParser(); a.add_argument("data", type=Path); a.add_argument("out", type=Path); a.add_argument("--only", default=""); a.add_argument("--poses", type=int, default=30); a.add_argument("--seed", type=int, default=0); a.add_argument("--bad", action="store_true"); a.add_argument("--columns", type=int, default=3); a.add_argument("--frames", default="")
    o = a.parse_args()
    torch.set_num_threads(1)
    ms = [m for m in read_motions(o.data) if not o.only or m.name in o.only.split(",")]
    rng = np.random.default_rng(o.seed)
    picks = []
    if o.frames:
        for t in o.frames.split(","):
            n, f = t.split(":"); m = next(m for m in ms if m.name == n); picks.append((m, int(f)))
    else:
        masks = [plausible(retarget(m), m.fps) for m in ms]
        allf = [(i, t) for i, k in enumerate(masks) for t in np.flatnonzero(~k if o.bad else k)]
        for q in rng.choice(len(allf), min(o.poses, len(allf)), replace=False):
            i, t = allf[q]; picks.append((ms[i], t))
    body = load_body(find_body(search=FREE_FOLDER)); mesh = Mesh(body)
    cells = []
    for m, t in picks:
        pose = retarget(m)[t]
        root = m.world(RIGS[m.source].pelvis)[t]
        fwd = root[:, 2] if abs(root[1, 2]) < .9 else root[:, 1]
        unyaw = Rotation.from_euler("y", -np.arctan2(fwd[0], fwd[2])).as_matrix()
        p = BodyParams.neutral(1)
        p.body_pose[0] = torch.as_tensor(pose); p.global_orient[0] = torch.as_tensor(Rotation.from_matrix(unyaw @ root).as_rotvec())
        v = mesh(p)[0].double().numpy(); J = mesh.joints(p)[0].double().numpy()
        X = (m.positions[t] - m.positions[t, 0]) @ unyaw.T
        X = X + J[0] - [0, .03, 0]
        views = [view_of(v, degrees=d, size=(220, 260)) for d in (0, 70)]
        e = max(w.extent for w in views)
        views = [View(center=w.center, extent=e, degrees=w.degrees, size=w.size) for w in views]
        cols = [(200, 60, 60) if n.startswith("r") and n not in ("root",) else (60, 80, 200) if n.startswith("l") else (90, 90, 90) for n in m.skeleton.joints]
        cells.append(Cell(picture=beside([q for w in views for q in (skeleton_picture(X, m.skeleton.parents, w, colors=cols), body_picture(v, body.faces, w))]), caption=f"{m.name} {t}: {m.description}"))
    write_sheet(o.out, cells, o.columns)


if __name__ == "__main__":
    main()
