# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # A first forecast
#
# Three people walk, run and stride; one of the nine clips is missing. We learn a model
# from the eight, make the ninth, and forecast it from its first frames. The walkers
# are synthetic, so the truth is known.

# %%
import warnings

import bayesmotion as bm

# %% tags=["parameters"]
max_steps = 240

# %%
settings = {"frame_rate": 20.0, "seed": 0}
motion = bm.synthetic_walkers(leave_out=[("ben", "stride")], seconds=1.3, **settings)
motion

# %% [markdown]
# Real recordings have defects. `check` tells them; here there are none.

# %%
print(bm.describe(bm.check(motion)))

# %% [markdown]
# ## Fit
#
# A short search, to keep this page quick; a fit says whether it converged.

# %%
with warnings.catch_warnings():
    warnings.simplefilter("ignore", bm.MotionWarning)
    method = bm.MAP(initial=1, keep=1, max_steps=max_steps)
    fit = bm.fit(bm.Multifactor(content=bm.Circle()), motion, method=method, seed=0)
fit

# %% [markdown]
# The style vectors of the gaits: how alike two gaits are is their inner product.

# %%
levels = fit.training.levels["gait"]
bm.plots.styles(fit.values()["style_gait"], levels, title="gait")

# %% [markdown]
# ## The clip nobody recorded

# %%
stride = bm.synthesize(fit, {"subject": "ben", "gait": "stride"}, seconds=2.0)
bm.stick_figures(stride.motion).figure

# %% [markdown]
# ## Forecast
#
# The model sees 15 frames of a clip and is told neither who it is nor in which gait.

# %%
clip = bm.split(bm.synthetic_walkers(seconds=1.75, **settings))["ben-stride"]
future = bm.forecast(fit, clip, context=15, horizon=20)
bm.forecast_picture(fit, clip, future)

# %% [markdown]
# How far off it is, beside three simple forecasts.

# %%
found = bm.forecast_scores(fit, clip, future)
assert found is not None, "the clip goes on for as long"
print(f"error {found.error:.3f} rad; 90 % interval held {found.coverage90:.0%}")
for name, error in found.baselines.items():
    print(f"{name.replace('_', ' ')}: {error:.3f} rad")

# %% [markdown]
# ## An arm that was not recorded
#
# Joints that are missing are NaN, or named; they are predicted from all that is seen.

# %%
whole = bm.reconstruct(fit, clip, missing=["larm"])
bm.plots.compare({"recorded": clip, "left arm reconstructed": whole.motion})
