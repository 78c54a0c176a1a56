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

import numpy as np

import bayesmotion as bm
from bayesmotion.motion import check, describe, split
from bayesmotion.motion.synthetic import synthetic_walkers
from bayesmotion.plots import stick_figures, styles
from bayesmotion.tasks.report import forecast_picture, report

settings = {"frame_rate": 20.0, "seed": 0}
motion = synthetic_walkers(leave_out=[("ben", "stride")], seconds=1.3, **settings)
motion

# %% [markdown]
# Real recordings have defects. `check` tells them; here there are none.

# %%
print(describe(check(motion)))

# %% [markdown]
# ## Fit
#
# A short search, to keep this page quick; a fit says whether it converged.

# %%
with warnings.catch_warnings():
    warnings.simplefilter("ignore", bm.MotionWarning)
    method = bm.MAP(initial=1, keep=1, max_steps=240)
    fit = bm.fit(bm.Multifactor(content=bm.Circle()), motion, method=method, seed=0)
fit.tree["sample_stats"].ds

# %% [markdown]
# The style vectors of the gaits: how alike two gaits are is their inner product.

# %%
levels = fit.training.levels["gait"]
styles(fit.values()["style_gait"], levels, title="gait")

# %% [markdown]
# ## The clip nobody recorded

# %%
stride = bm.synthesize(fit, {"subject": "ben", "gait": "stride"}, seconds=2.0)
stick_figures(stride.motion).figure

# %% [markdown]
# ## Forecast
#
# The model sees 15 frames of a clip and is told neither who it is nor in which gait.

# %%
clip = split(synthetic_walkers(seconds=1.75, **settings))["ben-stride"]
future = bm.forecast(fit, clip, context=15, horizon=20)
forecast_picture(fit, clip, future)

# %%
told = report(fit, clip, future)
assert told is not None
print(f"error {told.error:.3f} rad; 90 % interval held {told.coverage90:.0%}")
for name, error in told.baselines.items():
    print(f"{name.replace('_', ' ')}: {error:.3f} rad")

# %%
assert told.error < min(told.baselines.values())
assert np.isfinite(future.sd).all()
