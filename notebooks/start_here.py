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
# # Start here
#
# From motion capture files to a posterior that is trusted and compared, in about ten minutes of
# reading. Every step is one call; what it needs to know stands beside it.
#
# You need a folder of recordings and a table of labels. To have some on every machine, the first
# cell writes AMC files, with their ASF skeletons, of two synthetic people who walk and run. One of the four clips, Ben's
# run, is kept aside: in the end we forecast it.

# %% tags=["parameters"]
warmup, draws, chains = 300, 600, 4
max_steps = 400
forecast_draws = 25

# %%
from pathlib import Path
from tempfile import mkdtemp

import bayesmotion as bm

folder = Path(mkdtemp())
recorded = bm.split(
    bm.synthetic_walkers(("ann", "ben"), ("walk", "run"), seconds=1.5, frame_rate=20.0)
)
for name, clip in recorded.items():
    bm.write(clip, folder / f"{name}.amc")
(folder / "labels.csv").write_text(
    "clip,subject,gait\nann-walk,ann,walk\nann-run,ann,run\nben-walk,ben,walk\n"
)
sorted(path.name for path in folder.iterdir())

# %% [markdown]
# ## 1. Read and look
#
# `bm.read` takes files of any [format](../docs/data.md) and joins their clips; with your own files
# this is where you begin. A recording is an `xarray.Dataset`: joint angles in radians, the path of
# the root, and for every frame its clip, time and labels. AMC files do not say their frame rate, so we do.

# %%
training = ["ann-walk", "ann-run", "ben-walk"]
files = [folder / f"{name}.amc" for name in training]
motion = bm.read(*files, labels=folder / "labels.csv", frame_rate=20.0)
motion

# %% [markdown]
# `bm.check` looks for what goes wrong in recordings: flips, frozen stretches, a body below the
# floor, a rest pose at the start.

# %%
print(bm.describe(bm.check(motion)))

# %% [markdown]
# `bm.view` shows the clips moving. Drag to turn, space to play. It is one HTML page that asks
# no network for anything; `bm.view(motion).write("clips.html")` keeps it.

# %%
bm.view(motion)

# %% [markdown]
# ## 2. Fit
#
# `bm.models()` lists the models; [which model do I want?](../docs/which-model.md) helps to choose.
# Here it is `Multifactor`: a pose depends on *who* moves, in *which gait*, and on the *phase* of the
# cycle. These walkers have independent noise in every frame, so we say `residual=bm.White()`;
# recordings of people want the default, `bm.OU()`.
#
# `bm.NUTS` draws from the posterior. It first looks for the mode and takes its units from
# there. On your own data begin with `method="map"`, the mode alone, which takes seconds.

# %%
model = bm.Multifactor(residual=bm.White())
method = bm.NUTS(warmup=warmup, draws=draws, chains=chains)
fit = bm.fit(model, motion, method=method, seed=0)
fit

# %% [markdown]
# ## 3. Are the draws to be trusted?
#
# `bm.diagnose` looks only at quantities that data can tell. Raw style vectors may be rotated, and
# phases shifted, without changing anything the model says, so their R-hat would mean nothing.

# %%
bm.diagnose(fit)

# %% [markdown]
# Does the model make motions like the recorded ones? New recordings are drawn from the posterior and
# measured as the true ones were. Blue points lie inside the band that holds 90 % of the draws;
# vermilion ones say what the model does not do as people do.

# %%
check = bm.predictive_check(fit, "posterior", draws=forecast_draws, seed=0)
drawn = check.drawn.mean("clip").transpose("draw", "statistic")
words = ("ltibia/rx", "lfemur", "lhumerus", "head", "period", "speed", "sliding")
names = [str(name) for name in drawn["statistic"].values]
names = [name for name in names if any(word in name for word in words)]
recorded = check.recorded.mean("clip").sel(statistic=names)
bm.plots.checks_plot(drawn.sel(statistic=names).values, recorded.values, names)

# %% [markdown]
# Period and speed are right. Vermilion tells what to expect of this model: it has one share of noise for all
# joints, so in what it draws a head that hardly moves moves more than it does and knees bend less; and nothing in it
# says that a foot on the floor stands still. A forecast suffers less from that than these draws, because it goes on
# from recorded frames.

# %% [markdown]
# ## 4. Predict what was never recorded
#
# Ben's run was never seen. The model sees the first 12 frames of it (0.6 s) and is told neither who
# runs nor that it is a run. The forecast averages over draws of the model and over all phases and
# styles that these frames leave possible.

# %%
clip = bm.read(folder / "ben-run.amc", frame_rate=20.0)
future = bm.forecast(fit, clip, context=12, horizon=16, draws=forecast_draws)
bm.forecast_picture(fit, clip, future)

# %% [markdown]
# How good is it? The error in radians beside those of three simple forecasts, and the share of
# angles inside the 90 % interval, which should be about nine in ten.

# %%
found = bm.forecast_scores(fit, clip, future)
assert found is not None, "the clip goes on for as long"
print(f"error {found.error:.3f} rad; the 90 % interval held {found.coverage90:.0%}")
for name, error in found.baselines.items():
    print(f"{name.replace('_', ' ')}: {error:.3f} rad")

# %% [markdown]
# The same, moving, over what happened. The faint bodies are draws of the forecast.

# %%
bm.view(future, truth=clip)

# %% [markdown]
# The same fit fills in an arm that was not recorded, and makes the whole clip from its labels.

# %%
whole = bm.reconstruct(fit, clip, missing=["larm"], draws=forecast_draws)
made = bm.synthesize(fit, {"subject": "ben", "gait": "run"}, seconds=1.5, draws=forecast_draws)
bm.plots.compare(
    {"recorded": clip, "left arm filled in": whole.motion, "made from labels": made.motion}
)

# %% [markdown]
# ## 5. Which model?
#
# Does it matter who moves, and how? We fit a second model without style factors and ask which of
# the two gives more probability to frames that are left out. A difference counts when it is more
# than twice its standard error.

# %%
fits = {
    name: bm.fit(
        bm.Multifactor(residual=bm.White(), factors=factors),
        motion,
        method=bm.MAP(initial=2, max_steps=max_steps),
        seed=0,
    )
    for name, factors in (("who and how", model.factors), ("phase alone", ()))
}
comparison = bm.compare(fits)
print("\n".join(comparison.sentences))
comparison.table

# %% [markdown]
# ## 6. Keep it
#
# A fit is one netCDF file, an ArviZ tree inside, and predicts as before when it is loaded. A report
# is one HTML page: warnings first, then convergence, checks, forecasts and the player.

# %%
fit.save(folder / "fit.nc")
again = bm.load(folder / "fit.nc")
bm.write(made.motion, folder / "ben-run-made.bvh")
again

# %% [markdown]
# ```python
# bm.report(fit, clips=clip, context=12).write("report.html")
# ```
#
# ## Where to go from here
#
# - [Which model do I want?](../docs/which-model.md)
# - A notebook for each paper: [multifactor](multifactor.py), [speech](speech.py),
#   [gait-pose](gait_pose.py), [keyposes](keypose.py), [voxels](voxel.py)
# - [Posterior analysis with ArviZ](posterior_analysis.py), [comparing models](model_comparison.py),
#   [a model of your own](your_own_model.py)
# - [Sharp bits](../docs/sharp-bits.md), and [questions people ask](../docs/faq.md)
