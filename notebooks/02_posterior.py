# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # A posterior, trusted and compared
#
# From clips to draws, from draws to a diagnosis, and from two models to the better one.
# The walkers are synthetic; with recordings of your own, read them by `bm.read`.

# %%
import warnings

import bayesmotion as bm

# %% tags=["parameters"]
warmup, draws, chains = 300, 600, 4
max_steps = 150
forecast_draws = 40

# %%
settings = {"gaits": ("walk", "run"), "frame_rate": 20.0}
motion = bm.synthetic_walkers(leave_out=[("ben", "run")], seconds=1.5, **settings)

# %% [markdown]
# ## Draws
#
# The sampler begins around the mode, in the units of the Hessian there; the scales of the
# outputs are integrated out and drawn again. A checkpoint makes a long run resumable.
# These walkers have white noise; recordings want `residual=bm.OU()`, the default.

# %%
model = bm.Multifactor(residual=bm.White())
method = bm.NUTS(warmup=warmup, draws=draws, chains=chains)
fit = bm.fit(model, motion, method=method, seed=0)
fit

# %% [markdown]
# ## Are they to be trusted?
#
# Only what is identified is judged: raw style vectors and phases count up to a rotation.

# %%
bm.diagnose(fit)

# %% [markdown]
# ## A forecast that knows how unsure it is
#
# Averaged over draws of the model, and over the modes of the new clip's own unknowns.

# %%
clip = bm.synthetic_truth(**settings).cell("ben", "run")
future = bm.forecast(fit, clip, context=12, horizon=8, draws=forecast_draws)
found = bm.forecast_scores(fit, clip, future)
assert found is not None, "the clip goes on for as long"
print(found.scores)
bm.forecast_picture(fit, clip, future)

# %% [markdown]
# ## Which model?
#
# Does it matter who walks, and how? Every frame is left out in turn, by the exact
# conditional of the Gaussian process, with style factors and without.

# %%
with warnings.catch_warnings():
    # A few steps are enough to see the difference.
    warnings.simplefilter("ignore", bm.MotionWarning)
    method = bm.MAP(initial=2, max_steps=max_steps)
    fits = {
        name: bm.fit(bm.Multifactor(residual=bm.White(), factors=factors), motion, method=method)
        for name, factors in (("styles", model.factors), ("no styles", ()))
    }
comparison = bm.compare(fits)
print("\n".join(comparison.sentences))
comparison.table
