# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # From voxels to pose
#
# Sun, Bray, Thayananthan, Yuan and Torr, *Regression-based human motion capture from voxel data*, 2006.
#
# **The question.** Cameras around somebody see silhouettes, silhouettes carve voxels. Can the pose be read off the
# voxels of a single frame, with how sure that is, without tracking?
#
# ## The equations and the program
#
# | paper | program | what it is |
# | --- | --- | --- |
# | $t_i\sim\sum_k\pi_k\mathcal{N}(\mu_k, W_kW_k^\top+\sigma_k^2 I)$ | `PPCAMixture(mixture, len(points.t))` | shape contexts come from a mixture of probabilistic PCA |
# | $x_{fk}=\sqrt{\mathrm{mean}_d\,p(k\mid d)}$ (eq. 5) | `features(` | a frame's feature: how much of it each component explains |
# | $y_{fp}=\sum_b\Phi_{fb}W_{bp}+\mathrm{noise}$ | `dist.Normal(design.phi @ W, jnp.sqrt(noise)).mask(seen)` | poses by relevance vectors on the features |
# | $W_{bp}\sim\mathcal{N}(0,1/\alpha_b)$ | `dist.Normal(0.0, alpha[:, None] ** -0.5)` | most weights are told to be zero |
#
# The program:

# %% tags=["parameters"]
check_draws = 60
em_steps = 40

# %%
import inspect
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import bayesmotion as bm

print(inspect.getsource(bm.VoxelPose.program))

# %% [markdown]
# ## Recordings
#
# Two seconds of a synthetic walk as four cameras see it: the voxels of every frame, and the poses. With
# motion capture files of your own, `bm.VoxelPose.read(["walk.bvh"], rate=30, cameras=6)` carves such voxels.

# %%
model, seen = bm.example("voxel_pose")
bm.view(seen)

# %% [markdown]
# ## What the model believes beforehand

# %%
method = bm.EM(max_steps=em_steps)
fit = bm.fit(model, seen, method=method, seed=0)


def check_picture(kind):
    """Return the picture of a predictive check."""
    check = bm.predictive_check(fit, kind, draws=check_draws, seed=0)
    drawn = check.drawn.mean("clip").transpose("draw", "statistic")
    names = [str(name) for name in drawn["statistic"].values]
    return bm.plots.checks_plot(drawn.values, check.recorded.mean("clip").values, names)


check_picture("prior")

# %% [markdown]
# ## Fit
#
# The paper's estimate: the mixture by EM, then the regression by fast marginal likelihood.

# %%
fit

# %% [markdown]
# ## Criticism

# %%
check_picture("posterior")

# %% [markdown]
# ## Poses of voxels
#
# Here those of another walk, made in the same way: two angles over time, with the 90 % interval, and what is
# true. A mixture of three components and 16 frames, small enough for a notebook, tell next to nothing of a new walk;
# and the model says so: it stays at the mean of the training poses, with intervals as wide as poses vary. What
# mixtures of the paper's size tell of thousands of frames stands in the tables below.

# %%
_, other = bm.example("voxel_pose", seed=1)
found = bm.recognize_pose(fit, other.drop_vars("angle"))
truth = other["angle"].sel(dof=list(found.labels)).values
swing = np.argsort(-np.nanstd(truth, axis=0))[:2]
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7, 3.6), layout="constrained")
for ax, i in zip(axes, swing, strict=True):
    mean, sd = np.degrees(found.angles[:, i]), np.degrees(found.sd[:, i])
    times = range(len(mean))
    ax.fill_between(
        times, mean - 1.645 * sd, mean + 1.645 * sd, color="#CFE3F2", label="90 % interval"
    )
    ax.plot(times, mean, color="#0072B2", label="from the voxels")
    ax.plot(times, np.degrees(truth[:, i]), "k--", label="true")
    ax.set_title(found.labels[i], fontsize="small", loc="left")
    ax.set_ylabel("degrees")
labelled = axes[0].get_legend_handles_labels()
figure.legend(*labelled, loc="outside upper center", ncols=3, fontsize="small")
_ = axes[-1].set_xlabel("frame")
# %% [markdown]
# ## The paper's table beside ours
#
# Errors in degrees of walks with turns, from the file of results that `bayesmotion reproduce voxel` writes;
# the paper's are of its own spiral walk.

# %%
results = json.loads(Path("../docs/results/voxel.json").read_text(encoding="utf-8"))
titles = {"rvm_mppca": "relevance vectors, mixture of PPCA", "rvm_kmeans": "relevance vectors, k-means",
          "agarwal_triggs": "Agarwal and Triggs", "ridge": "ridge regression",
          "nearest": "nearest training frame"}  # fmt: skip
table = {}
for part, row in results["table1"].items():
    for whose, source in (("paper", results["paper"]["table1"][part]), ("ours", row)):
        table[part.replace("_", " "), whose] = {titles[k]: source.get(k) for k in titles}
pd.DataFrame(table).round(1).fillna("-")

# %% [markdown]
# ## Where it fails
#
# Motions that nobody in training made, and people who were never seen: errors in degrees, and how often the
# 90 % intervals hold.

# %%
pd.DataFrame(
    {
        "known people, error": {m: row["rvm_mppca"] for m, row in results["motions"].items()},
        "intervals hold": results["coverage90"],
        "new people, error": {m: r["rvm_mppca"] for m, r in results["subjects_apart"].items()},
        "intervals hold ": results["subjects_apart_coverage90"],
    }
).round(2)

# %% [markdown]
# Fewer cameras than in training leave voxels uncarved, and cost more than other places for as many cameras:

# %%
pd.DataFrame(results["cameras"]).T[["rvm_mppca", "ridge", "nearest"]].round(1)

# %% [markdown]
# Each frame is taken by itself, so nothing says that a left leg stays the left leg from one frame to the next.
