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
# From clips to draws, from draws to a verdict, and from two models to the better one.
# The walkers are synthetic; with recordings of your own, read them by `read`.

# %%
import warnings

import bayesmotion as bm
from bayesmotion.motion.synthetic import synthetic_truth, synthetic_walkers
from bayesmotion.tasks.report import report

settings = {"gaits": ("walk", "run"), "frame_rate": 20.0}
motion = synthetic_walkers(leave_out=[("ben", "run")], seconds=1.5, **settings)

# %% [markdown]
# ## Draws
#
# The sampler begins around the mode, in the units of the Hessian there; the scales of the
# outputs are integrated out and drawn again. A checkpoint makes a long run resumable.
# These walkers have white noise; recordings want `residual=bm.OU()`, the default.

# %%
model = bm.Multifactor(residual=bm.White())
fit = bm.fit(model, motion, method=bm.NUTS(warmup=300, draws=600, chains=4), seed=0)
fit.tree["posterior"]

# %% [markdown]
# ## Are they to be trusted?
#
# Only what data can tell is judged: raw style vectors and phases are free to turn.

# %%
found = bm.diagnose(fit)
print("\n".join([*found.sentences, *found.problems]))

# %% [markdown]
# ## A forecast that knows how unsure it is
#
# Averaged over draws of the model, and over the modes of the new clip's own unknowns.

# %%
clip = synthetic_truth(**settings).cell("ben", "run")
future = bm.forecast(fit, clip, context=12, horizon=8, draws=40)
told = report(fit, clip, future)
assert told is not None, "the clip goes on for as long"
print(told.scores)

# %% [markdown]
# ## Which model?
#
# Does it matter who walks, and how? Every frame is left out in turn, by the exact
# conditional of the Gaussian process, with style factors and without.

# %%
with warnings.catch_warnings():
    # A few steps are enough to see the difference.
    warnings.simplefilter("ignore", bm.MotionWarning)
    method = bm.MAP(initial=2, max_steps=150)
    fits = {
        name: bm.fit(bm.Multifactor(residual=bm.White(), factors=factors), motion, method=method)
        for name, factors in (("styles", model.factors), ("no styles", ()))
    }
print("\n".join(bm.compare(fits).sentences))
