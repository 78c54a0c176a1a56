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
# # Gait-pose manifolds
#
# Ding and Fan, *Multilayer joint gait-pose manifolds for human gait motion modeling*, IEEE Transactions
# on Cybernetics, 2015.
#
# **The question.** All walks lie on one surface: around it the phase of the cycle, along it the gaits of
# people, from one layer to the next the length of strides. If the surface is known, can a missing arm
# be filled in, or noise be taken out, for a walker who was never recorded?
#
# ## The equations and the program
#
# | paper | program | what it is |
# | --- | --- | --- |
# | $p(X\mid W)$ | `LocallyLinear(` | latent points keep to a torus or cylinder: each is nearly the same mixture of its neighbours as on the ideal surface |
# | $k=\sigma^2 e^{-\frac{\gamma}{2}\lVert x-x'\rVert^2}+\delta/\beta$ (eq. 11) | `K = covariance(hyper, x)` | covariance of two poses |
# | $y_d\sim\mathcal{GP}(0,k)$ | `GaussianProcess(K, jnp.ones(frames.y.shape[1]), None, frames.missing)` | every feature of the pose, in millimetres it moves |
#
# The program:

# %% tags=["parameters"]
import os

real = "BAYESMOTION_DATA" in os.environ
sweeps = 60
check_draws = 60
poses = 30

# %%
import inspect
import json
from pathlib import Path

import numpy as np
import pandas as pd

import bayesmotion as bm

print(inspect.getsource(bm.GaitPose.program))

# %% [markdown]
# ## Recordings
#
# Gait cycles, cut from one left heel strike to the next, on one body: walks of the CMU collection where
# `BAYESMOTION_DATA` names their folder, else synthetic walkers. One walker is kept aside.

# %%
if real:
    walks = bm.downsample(bm.cmu(["02_01", "05_01", "12_02", "16_15", "49_01"]), 4)
    stranger = "16_15"
else:
    people = ("ann", "ben", "cas", "dee")
    walks = bm.synthetic_walkers(people, ("walk",), seconds=2.6, styles=2)
    stranger = "dee-walk"
clips = bm.split(walks)
clip = clips.pop(stranger)
cycles = bm.cycles_of(bm.concat(list(clips.values())), 1, poses=poses)
bm.stick_figures(bm.split(cycles)[bm.clips(cycles)[0]]).figure

# %% [markdown]
# ## What the model believes beforehand
#
# Cycles drawn from the prior, measured as the recorded ones are, in the model's own unit: one is the root mean
# square of all features, and features are in the millimetres that they move.

# %%
model = bm.GaitPose()
fit = bm.fit(model, cycles, method=bm.LocalLearning(sweeps=sweeps), seed=0)


def check_picture(kind):
    """Return the picture of a predictive check."""
    check = bm.predictive_check(fit, kind, draws=check_draws, seed=0)
    drawn = check.drawn.mean("clip").transpose("draw", "statistic")
    names = [str(name) for name in drawn["statistic"].values]
    kept = [i for i, name in enumerate(names) if "range" not in name or i % 3 == 0]
    recorded = check.recorded.mean("clip").values
    return bm.plots.checks_plot(drawn.values[:, kept], recorded[kept], [names[i] for i in kept])


check_picture("prior")

# %% [markdown]
# ## Fit
#
# Local learning climbs the density patch by patch. The latent points: one closed ring a walker, side by
# side along the tour of gaits.

# %%
fit

# %%
points = fit.values()["x"]
people = cycles["subject"].values
bm.plots.latent_space(points[None], {"walker": people}, paths=cycles["clip"].values)

# %% [markdown]
# ## Criticism

# %%
check_picture("posterior")

# %% [markdown]
# ## An arm that is missing
#
# The walker who was kept aside, without the left arm. The recording holds the arm all the same, so the
# error is told in millimetres beside those of simple methods. With so few walkers in training the nearest pose of one
# of them can be as good; the study below has more.

# %%
whole = bm.reconstruct(fit, clip, missing=["larm"])
score = whole.score
assert score is not None, "the arm was recorded"
print(score)
bm.plots.compare({"recorded": whole.given, "left arm filled in": whole.motion})

# %% [markdown]
# ## The study
#
# Mean error in millimetres over test cycles, the left arm missing, at stride scale 1; from the file of
# results that `bayesmotion reproduce gait-pose` writes. The paper gives such errors as curves, on
# recordings of its own choice, so there is no column of its numbers; `torus1` is its JGPM,
# `torus3` and `cylinder3` its multilayer models.

# %%
results = json.loads(Path("../docs/results/gait-pose.json").read_text(encoding="utf-8"))
rules = {"published rule": "reconstruction", "with shared residuals": "reconstruction_shared"}
pd.DataFrame(
    {
        (limb, rule): {
            name: f"{value[0]:.0f} ± {value[1]:.0f}"
            for name, value in results[key][limb]["1"].items()
        }
        for limb in results["reconstruction"]
        for rule, key in rules.items()
    }
)

# %% [markdown]
# ## Where it fails
#
# Strides far longer than any in training. The same table by stride scale, for the torus of three layers and
# the left arm: the last column are strides that were recorded long, and there the arm swings
# farther than any layer of the surface holds.

# %%
by_scale = results["reconstruction_shared"]["left arm"]
pd.DataFrame(
    {scale: {name: row[name][0] for name in ("torus3", "pca", "nearest")}
     for scale, row in by_scale.items()}
).round(0)  # fmt: skip

# %% [markdown]
# Other limits:
#
# - Only straight walking: a cycle that turns is not on the surface.
# - With dynamics whose parameters are searched for (`PathDynamics()`) the prior has a constant nobody
#   knows: there is a mode, and no posterior to sample.
# - Point estimates: intervals go by one set of trained values.

# %%
limbs = np.array([results["coverage90"][limb]["1"]["torus3"] for limb in results["coverage90"]])
print("90 % intervals of the torus of three layers hold:", (100 * limbs).round().tolist(), "%")
