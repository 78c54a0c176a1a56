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
# # A face from speech
#
# Deena and Galata, *Speech-driven facial animation using a shared Gaussian process latent variable
# model*, 2009; beside it Brand's *Voice puppetry*, 1999.
#
# **The question.** Sound and face are two views of one thing, a mouth that moves. If both are functions
# of one latent path, can the path be found from new sound alone, and the face read off it, with how
# sure that is?
#
# ## The equations and the program
#
# | paper | program | what it is |
# | --- | --- | --- |
# | $x_t\sim\mathcal{GP}(x_{t-1})$ | `GPDynamics(alpha, frames.steps, (n, q))` | the latent path: a Gaussian process from each point to the next |
# | $k_v=\sigma_v^2 e^{-\frac12\sum_q\gamma_{vq}(x_q-x_q')^2}+\dots+\delta/\beta_v$ | `view_covariance(name, hyper, points)` | covariance of two frames in view $v$ |
# | $y_v\sim\mathcal{GP}(0,k_v)$ | `numpyro.sample(name, GaussianProcess(K, ones, missing=missing), obs=y)` | every feature of the view: cepstra of the sound, coordinates of the face |
# | $s_t\sim A_{s_{t-1}}$ (Brand) | `chain(values["initial"], values["transition"], frames.begins)` | voice puppetry: a chain of facial states |
#
# The two programs:

# %% tags=["parameters"]
max_steps = 600
path_steps = 100
check_draws = 60

# %%
import inspect
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import bayesmotion as bm

print(inspect.getsource(bm.SharedGPLVM.program))
print(inspect.getsource(bm.VoicePuppetry.program))

# %% [markdown]
# ## Recordings
#
# A "mouth" that goes through three positions, with a sound of its own for each: three clips of 20 frames,
# three features of sound and two of a face. Sound files and tracks of a real face are read by
# `bayesmotion fit shared-gplvm a.wav b.wav`, see [the page](../docs/speech.md). The last clip is left out of
# the training.

# %%
puppetry, talk = bm.example("voice_puppetry")
names = list(dict.fromkeys(talk["clip"].values.tolist()))
known = talk.isel(frame=talk["clip"].values != names[-1])
new = talk.isel(frame=talk["clip"].values == names[-1])
known

# %% [markdown]
# ## What the model believes beforehand

# %%
model = bm.SharedGPLVM(latent_size=2)
fit = bm.fit(model, known, method=bm.MAP(initial=2, keep=1, max_steps=max_steps), seed=0)
chain = bm.fit(puppetry, known, method=bm.EM(max_steps=max_steps), seed=0)


def check_picture(of, kind):
    """Return the picture of a predictive check."""
    check = bm.predictive_check(of, kind, draws=check_draws, seed=0)
    drawn = check.drawn.mean("clip").transpose("draw", "statistic")
    names = [str(name) for name in drawn["statistic"].values]
    return bm.plots.checks_plot(drawn.values, check.recorded.mean("clip").values, names)


check_picture(fit, "prior")

# %% [markdown]
# ## Fit
#
# The latent path at the mode, one colour a clip. It counts up to a rotation; what does not are the
# distances between its points (`bm.identified`).

# %%
fit

# %%
bm.plots.content_path(fit.values()["x"], known["clip"].values)

# %% [markdown]
# ## Criticism

# %%
check_picture(fit, "posterior")

# %% [markdown]
# ## A face from new sound
#
# The face of the new clip is not looked at. All paths that the sound leaves possible count, each by its
# mass, and the interval says how far the face is told. Beside it the chain of voice puppetry.

# %%
heard = new.drop_vars("face")
face, puppet = (bm.audio_to_face(one, heard, max_steps=path_steps) for one in (fit, chain))
truth, mean = new["face"].values, face.means()
low, high = face.quantile(0.05), face.quantile(0.95)
figure, axes = plt.subplots(truth.shape[1], 1, sharex=True, figsize=(7, 4), layout="constrained")
for i, ax in enumerate(axes):
    ax.fill_between(
        range(len(truth)), low[:, i], high[:, i], color="#CFE3F2", label="90 % interval"
    )
    ax.plot(mean[:, i], color="#0072B2", label="shared GPLVM")
    ax.plot(puppet.means()[:, i], color="#D55E00", label="voice puppetry")
    ax.plot(truth[:, i], "k--", label="recorded")
    ax.set_ylabel(str(new["coordinate"].values[i]))
labelled = axes[0].get_legend_handles_labels()
figure.legend(*labelled, loc="outside upper center", ncols=4, fontsize="small")
_ = axes[-1].set_xlabel("frame")
# %% [markdown]
# ## The study
#
# The paper reports no table on data that can be had; the protocol here is one speaker with sensors on
# lips and tongue, a random split repeated ten times. From the file of results that
# `bayesmotion reproduce speech` writes: means and standard deviations over the repeats.

# %%
results = json.loads(Path("../docs/results/speech.json").read_text(encoding="utf-8"))
titles = {"sgplvm_a": "shared GPLVM, start A", "sgplvm_b": "shared GPLVM, start B",
          "sgplvm_window": "shared, window of sound", "voice_puppetry": "voice puppetry",
          "ridge": "ridge regression", "gp_regression": "GP regression"}  # fmt: skip
columns = {"rms_mm": "error, mm", "correlation": "correlation", "coverage90": "90 % intervals hold"}
pd.DataFrame(
    {
        title: {
            head: "-" if key not in results["ema"][name]
            else f"{results['ema'][name][key][0]:.2f} ± {results['ema'][name][key][1]:.2f}"
            for key, head in columns.items()
        }
        for name, title in titles.items()
    }
).T  # fmt: skip

# %% [markdown]
# ## Where it fails
#
# Sound that was never heard. We add noise to the new sound, step by step: the error grows, and intervals ought to
# grow with it. Those of the shared model do, though not enough; those of the chain do not, because a state is
# chosen whatever the sound is, and each state is sure of its face.

# %%
random = np.random.default_rng(0)
noise = random.normal(size=new["audio"].shape)
rows = {}
for sd in (0.0, 1.0, 3.0):
    for title, one in (("shared GPLVM", fit), ("voice puppetry", chain)):
        noisy = heard.assign(audio=new["audio"] + sd * noise)
        told = bm.audio_to_face(one, noisy, max_steps=path_steps)
        inside = (told.quantile(0.05) <= truth) & (truth <= told.quantile(0.95))
        rows[title, f"noise of {sd:g}"] = {
            "error": np.sqrt(np.mean((told.means() - truth) ** 2)),
            "mean sd": told.sds().mean(),
            "90 % intervals hold": inside.mean(),
        }
pd.DataFrame(rows).T.round(2)

# %% [markdown]
# Other limits:
#
# - The shared models of the paper, through one frame of sound, err as much as ridge regression; a window
#   of sound is what helps (see the table).
# - With a back-constraint the model is no density: there is a mode, and nothing to sample.
# - The opening of lips that close fast (p, b, m) is smoothed by voice puppetry: its lips move less than the true ones.
