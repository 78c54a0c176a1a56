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
# # Keyposes, and who does what
#
# Perera, Kudoh and Ikeuchi, *Keypose and style analysis based on low-dimensional representation*, 2009.
#
# **The question.** Dancers hold poses on the beat. Which frames are these *keyposes*? And given a piece
# of motion, who is moving and what do they do, if the person and the task were seen apart but never
# together?
#
# ## The equations and the programs
#
# | paper | program | what it is |
# | --- | --- | --- |
# | a minimum of the energy flow near a beat, low or deep enough | `dist.BernoulliProbs(probability(data, trained)[:, None])` | a minimum is a keypose with a probability; deep in the global *or* in the body's frame |
# | $T_1$, $T_2$ | `"deep_global": dist.Normal(0.0, 1.5)` | the thresholds, in standard deviations of log depth |
# | $P=Q\times_1 S_{position}\times_2 S_{people}\times_3 S_{task}$ (eq. 12) | `covariance = self._covariance(data, values)` | motion as a tensor; its factors and core are integrated out |
# | segment $y_n$ of person $i$ and task $j$ | `MatrixT(covariance, scale, dof, data.y.shape[1])` | mean + person + task + how this person does this task + repetition |
#
# The two programs:

# %% tags=["parameters"]
check_draws = 60
warmup, draws, chains = 500, 800, 4

# %%
import inspect
import json
from pathlib import Path

import numpy as np
import pandas as pd

import bayesmotion as bm

print(inspect.getsource(bm.Keyposes.program))
print(inspect.getsource(bm.MotionTensor.program))

# %% [markdown]
# ## Part one: keyposes
#
# Two synthetic dances whose keyposes are known. The paper's rule, `bm.keyposes_of`, needs no fit: the energy
# flow in both frames of reference, beats as lines, and the poses it finds.

# %%
dance = bm.synthetic_dance(0, beats=16, noise=0.02)
found, in_global, in_body = bm.keyposes_of(dance.motion, dance.beats)
print("found", found.frame.tolist())
print("true ", dance.keyposes.tolist())
bm.stick_figures(dance.motion, frames=found.frame[:8], travel=False).figure

# %% [markdown]
# The model says the same with probabilities. Its prior, before any dance: thresholds of typical depth,
# keyposes within a tenth of a second of the beat.

# %%
model, dances = bm.example("keyposes")
method = bm.NUTS(warmup=warmup, draws=draws, chains=chains)
fit = bm.fit(model, dances, method=method, seed=0)


def check_picture(of, kind):
    """Return the picture of a predictive check."""
    check = bm.predictive_check(of, kind, draws=check_draws, seed=0)
    drawn = check.drawn.mean("clip").transpose("draw", "statistic")
    names = [str(name) for name in drawn["statistic"].values]
    kept = [i for i, name in enumerate(names) if "range" not in name or i % 3 == 0]
    recorded = check.recorded.mean("clip").values
    return bm.plots.checks_plot(drawn.values[:, kept], recorded[kept], [names[i] for i in kept])


check_picture(fit, "prior")

# %% [markdown]
# The depth at which a minimum is a keypose is told by few answers: its posterior has a long tail, at the end of which
# a step may diverge. The diagnosis says how many did.

# %%
bm.diagnose(fit)

# %% [markdown]
# The probability of every minimum near a beat to be a keypose, beside what it is.

# %%
probability = bm.predict(fit, dances).site().means()[:, 0]
answer = fit.tree["observed_data"]["keypose"].values[:, 0]
pd.DataFrame({"is a keypose": answer, "probability": probability.round(2)}).iloc[:12]

# %% [markdown]
# ## Part two: who, and what
#
# Three people who do two tasks, three times each. Prior first, then the fit, then its criticism.

# %%
model, clips = bm.example("motion_tensor")
names = bm.clips(clips)
new = [name for name in names if name.endswith("-2")]
known = clips.isel(frame=~np.isin(clips["clip"].values, new))
tensor = bm.fit(model, known, seed=0)
check_picture(tensor, "prior")

# %%
check_picture(tensor, "posterior")

# %% [markdown]
# The last repetition of everything was kept aside. Who is it, and what do they do? `(new)` is the
# probability that it is nobody, or nothing, of the training.

# %%
told = bm.recognize(tensor, clips.isel(frame=np.isin(clips["clip"].values, new)), p_new=0.1)
told["p_subject"].to_pandas().round(3)

# %%
told["p_task"].to_pandas().round(3)

# %% [markdown]
# ## The paper's table beside ours
#
# Shares named right, and unseen ones noticed, from the file of results that `bayesmotion reproduce keypose`
# writes. The paper has its own dances, we have HDM05.

# %%
results = json.loads(Path("../docs/results/keypose.json").read_text(encoding="utf-8"))
paper, ours, unseen = results["paper"], results["known"], results["unseen"]
rows = {
    f"{what} of known ones": {
        "paper": paper["known"][what], "ours, the paper's rule": ours[what]["tensor_paper"],
        "ours, Bayesian": ours[what]["tensor_bayes"], "nearest neighbour": ours[what]["nearest"],
    }
    for what in ("task", "person")
}  # fmt: skip
rows |= {
    f"{what.replace('_', ' ')} noticed": {
        "paper": paper["unseen"][what],
        "ours, the paper's rule": unseen[what]["tensor_paper"]["found"]["share"],
        "ours, Bayesian": unseen[what]["tensor_bayes"]["found"]["share"],
    }
    for what in ("new_task", "new_person")
}
pd.DataFrame(rows).T.round(3)

# %% [markdown]
# ## Where it fails
#
# What tells a person is mostly how they stand. On vectors that hold movement alone, without the mean pose,
# fewer people are named right:

# %%
variants = results["variants"]
pd.DataFrame(
    {
        name.replace("_", " "): {
            what: one["known"][what]["tensor_bayes"] for what in ("task", "person")
        }
        for name, one in variants.items()
    }
).T.round(3)

# %% [markdown]
# And keyposes need a dancer who keeps to the music. With noise on the angles, or a dancer who drifts from the
# beat, fewer are found, and more are found that are none:

# %%
pd.DataFrame(results["synthetic"]["noise"]).round(2)

# %%
pd.DataFrame(results["synthetic"]["drift"]).round(2)

# %% [markdown]
# Other limits: a Tucker model for cells nobody recorded is better than adding up person and task by less than
# its uncertainty, and poses at the beats of recorded dances cover hardly more of the variance than poses
# taken evenly. [The page](../docs/keypose.md) has the tables.
