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

from bayesmotion.criticism.compare import compare
from bayesmotion.criticism.diagnostics import diagnose
from bayesmotion.errors import MotionWarning
from bayesmotion.inference.map import fit_map
from bayesmotion.inference.nuts import fit_nuts
from bayesmotion.models.factors import SUBJECT_AND_GAIT
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.motion.synthetic import synthetic_truth, synthetic_walkers
from bayesmotion.prediction import score
from bayesmotion.tasks.forecast import truth
from bayesmotion.tasks.posterior_forecast import forecast_posterior

settings = {"gaits": ("walk", "run"), "frame_rate": 20.0}
motion = synthetic_walkers(leave_out=[("ben", "run")], seconds=1.5, **settings)

# %% [markdown]
# ## Draws
#
# The sampler begins around the mode, in the units of the Hessian there; the scales of the
# outputs are integrated out and drawn again. A checkpoint makes a long run resumable.
# These walkers have white noise; recordings want `noise="drift"`, the default.

# %%
model = Multifactor(noise="white")
fit = fit_nuts(model, motion, warmup=300, draws=600, chains=4, seed=0)
fit.tree["posterior"]

# %% [markdown]
# ## Are they to be trusted?
#
# Only what data can tell is judged: raw style vectors and phases are free to turn.

# %%
found = diagnose(fit)
print("\n".join([*found.sentences, *found.problems]))

# %% [markdown]
# ## A forecast that knows how unsure it is
#
# Averaged over draws of the model and of the new clip's own unknowns.

# %%
clip = synthetic_truth(**settings).cell("ben", "run")
future = forecast_posterior(fit, clip, given=12, horizon=8, seed=0, trained=4, warmup=100)
true = truth(fit, clip, 12, 8)
assert true is not None, "the clip goes on for as long"
angles = slice(fit.training.encoding.n_angles)
print(score(future.mixture.part(slice(12, None), angles), true[:, angles]))

# %% [markdown]
# ## Which model?
#
# Does it matter who walks, and how? Every frame is left out in turn, by the exact
# conditional of the Gaussian process, with style factors and without.

# %%
with warnings.catch_warnings():
    # A few steps are enough to see the difference.
    warnings.simplefilter("ignore", MotionWarning)
    fits = {
        name: fit_map(
            Multifactor(noise="white", factors=factors),
            motion,
            starts=2,
            max_steps=150,
        )
        for name, factors in (("styles", SUBJECT_AND_GAIT), ("no styles", ()))
    }
print("\n".join(compare(fits).sentences))
