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
# # Multifactor Gaussian processes: who moves, how, and when
#
# Wang, Fleet and Hertzmann, *Multifactor Gaussian process models for style-content separation*, ICML 2007.
#
# **The question.** A recording of a walk shows three things at once: who walks, which gait it is, and
# where in the cycle the body is. Can they be told apart, so that a combination nobody recorded can be
# made, and a clip of somebody new be forecast from its first half second?
#
# ## The equations and the program
#
# | paper | program | what it is |
# | --- | --- | --- |
# | $s_i$, $g_j$ | `style_{factor.name}` | style vectors, one for each person and one for each gait |
# | $x_t=(\cos\theta_t,\sin\theta_t)$ | `circle(self._phases(frames, trained, styles))` | content: a point of the unit circle |
# | $\theta_t = \phi_c + \Delta_c\,t$ | `phase[frames.clip] + step[frames.clip] * frames.time` | phase in radians, growing at a pace of the clip's own |
# | $k=(s^\top s')(g^\top g')\,e^{-\frac{\gamma}{2}\lVert x-x'\rVert^2}+\delta/\beta$ | `K = self.process(frames, sites, points)` | covariance of two frames |
# | $y_d\sim\mathcal{GP}(0,k/w_d^2)$ | `GaussianProcess(K, hyper["scale"], loc, frames.missing)` | every feature of the pose: joint angles, their velocities, the root's |
#
# The whole program, as it is run:

# %% tags=["parameters"]
import os

real = "BAYESMOTION_DATA" in os.environ
max_steps = 2000
check_draws = 60
initial = 2

# %%
import inspect
import json
from pathlib import Path

import pandas as pd

import bayesmotion as bm

print(inspect.getsource(bm.Multifactor.program))

# %% [markdown]
# ## Recordings
#
# With the CMU recordings in the folder that `BAYESMOTION_DATA` names: the paper's six training clips,
# three people in three gaits, every fourth frame. Without: synthetic walkers, with a hole in the same
# place. `clip` is the one we will forecast; it is not among them.

# %%
if real:
    gaits = {"02_02": "walk", "02_03": "run", "35_01": "walk", "35_18": "run", "08_01": "walk",
             "08_07": "stride"}  # fmt: skip
    labels = {name: {"gait": gait} for name, gait in gaits.items()}
    motion = bm.downsample(bm.cmu(list(gaits), labels=labels), 4)
    clip, context, horizon = bm.downsample(bm.cmu("07_02"), 4), 15, 40
else:
    people, gaits = ("ann", "ben"), ("walk", "run")
    clips = bm.split(bm.synthetic_walkers(people, gaits, seconds=1.5, frame_rate=20.0))
    clip, context, horizon = clips.pop("ben-run"), 12, 16
    motion = bm.concat(list(clips.values()))
bm.stick_figures(clip).figure

# %% [markdown]
# ## What the model believes beforehand
#
# Before it has seen anyone: motions drawn from the prior, measured as the recordings were. Recorded
# values must lie inside, or the priors forbid what people do. (A band far wider than any body
# is no harm: the prior leaves the scale of every feature open.)

# %%
model = bm.Multifactor()
fit = bm.fit(model, motion, method=bm.MAP(initial=initial, max_steps=max_steps), seed=0)


def drawn_and_recorded(kind):
    """Return the picture of a predictive check."""
    check = bm.predictive_check(fit, kind, draws=check_draws, seed=0)
    drawn = check.drawn.mean("clip").transpose("draw", "statistic")
    names = [str(name) for name in drawn["statistic"].values]
    kept = [i for i, name in enumerate(names) if "range" not in name or i % 3 == 0]
    recorded = check.recorded.mean("clip").values
    return bm.plots.checks_plot(drawn.values[:, kept], recorded[kept], [names[i] for i in kept])


drawn_and_recorded("prior")

# %% [markdown]
# ## Fit
#
# The mode of the posterior, from several initial values (`bm.NUTS()` draws instead). The style vectors
# count only by their inner products: a value near one says that two gaits move alike.

# %%
fit

# %%
levels = fit.training.levels["gait"]
bm.plots.styles(fit.values()["style_gait"], levels, title="gait")

# %% [markdown]
# ## Criticism
#
# Does the fitted model make motions like these? The same statistics, drawn from the posterior. Period and speed are
# right; but one share of noise serves all joints, so that those that hardly move are drawn as moving more, knees as
# bending less; and feet slide, because no feature says that they stand still.

# %%
drawn_and_recorded("posterior")

# %% [markdown]
# ## A forecast
#
# The model sees the beginning of a clip, and is told neither who it is nor in which gait.

# %%
future = bm.forecast(fit, clip, context=context, horizon=horizon)
bm.forecast_picture(fit, clip, future)

# %% [markdown]
# The error frame by frame beside the means of three simple forecasts.

# %%
found = bm.forecast_scores(fit, clip, future)
assert found is not None, "the clip goes on for as long"
errors = {"multifactor": found.per_frame}
errors |= {name.replace("_", " "): 0 * found.per_frame + e for name, e in found.baselines.items()}
times = (context + pd.RangeIndex(horizon).to_numpy()) / fit.frame_rate
bm.plots.forecast_errors(times, errors).figure

# %% [markdown]
# ## The paper's table beside ours
#
# Mean error in radians of forecasts of eight clips, from the file of results that
# `bayesmotion reproduce multifactor` writes.

# %%
results = json.loads(Path("../docs/results/multifactor.json").read_text(encoding="utf-8"))
names = {"gpdm": "GPDM", "gpdm_style": "stylistic GPDM", "bgpdm": "B-GPDM",
         "bgpdm_style": "stylistic B-GPDM", "cdm_style": "stylistic circle"}  # fmt: skip
table = pd.DataFrame(
    {
        (clip, whose): {names[model]: source[clip][model] for model in names}
        for clip in results["table1"]
        for whose, source in (("paper", results["paper"]["table1"]), ("ours", results["table1"]))
    }
)
table[[("mean", "paper")]] = table.xs("paper", axis=1, level=1).mean(axis=1).to_frame()
table[[("mean", "ours")]] = table.xs("ours", axis=1, level=1).mean(axis=1).to_frame()
table.round(2)

# %% [markdown]
# ## Where it fails
#
# A movement that is no mixture of those it knows. Below somebody who trained does something that
# nobody in training did: the model follows the nearest gait it has, the error is many times that of the forecast
# above, and nothing but the warnings tells. Read them: they name a pace or a style outside training.

# %%
if real:
    odd = bm.downsample(bm.cmu("02_04"), 4)  # a jump and balance
else:
    odd = bm.synthetic_walkers(("ben",), ("stride",), seconds=1.5, frame_rate=20.0)
wrong = bm.forecast(fit, odd, context=context, horizon=16)
scores = bm.forecast_scores(fit, odd, wrong)
assert scores is not None, "the clip goes on for as long"
print(f"error {scores.error:.2f} rad; the 90 % interval held {scores.coverage90:.0%}")
print("\n".join(wrong.messages))
bm.forecast_picture(fit, odd, wrong, count=3)

# %% [markdown]
# Other limits:
#
# - The latent-path models (GPDM and B-GPDM) did not converge in the study, and their intervals hold less
#   often; the table above is of searches that were stopped.
# - Intervals of new people are too narrow: how often they hold is in the table of [the model's
#   page](../docs/model.md), and what averaging over the posterior betters in [that of the
#   posterior](../docs/posterior.md).
# - Feet slide: nothing in the features says that a foot stands still.
