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
# # Posterior analysis with ArviZ
#
# A fit *is* an ArviZ tree: `fit.tree` has the groups `posterior`, `sample_stats`, `log_likelihood`,
# `log_prior` and `observed_data`, so every function of ArviZ works on it without conversion. What ArviZ
# cannot know is which quantities of a motion model data can tell. `bm.identified` says that, and
# this notebook shows what to do with it: summaries, contrasts, leave-one-out checks of calibration,
# sensitivity to the priors, and weights for averaging models.

# %% tags=["parameters"]
warmup, draws, chains = 300, 600, 4
most = 200

# %%
import arviz as az

import bayesmotion as bm

motion = bm.synthetic_walkers(
    ("ann", "ben"), ("walk", "run"), leave_out=[("ben", "run")], seconds=1.5, frame_rate=20.0
)
model = bm.Multifactor(residual=bm.White())
method = bm.NUTS(warmup=warmup, draws=draws, chains=chains)
fit = bm.fit(model, motion, method=method, seed=0)
list(fit.tree.children)

# %% [markdown]
# ## Summaries of what is identified
#
# The style vector of Ann could be rotated together with all others, and every prediction would be the
# same. So `style_subject` has no posterior mean that means anything. Its inner products
# (`gram_subject`) and distances do, and so do steps of the phase, the noise, and predictions.

# %%
identified = bm.identified(fit)
az.summary(identified, var_names=["gamma", "beta", "step", "gram_gait"])

# %% [markdown]
# Traces and densities of the same quantities: chains that agree look like one another.

# %%
_ = az.plot_trace_dist(identified, var_names=["gamma", "beta", "step"], compact=False)
# %% [markdown]
# ## A contrast
#
# How much faster is a run than a walk? `step` is the phase that a clip gains in one frame, in
# radians; times the frame rate over $2\pi$ that is cycles a second. The contrast is computed draw by
# draw, so it comes with its uncertainty.

# %%
full_turn = 2 * 3.141592653589793
cadence = identified["step"] * fit.frame_rate / full_turn
contrast = cadence.sel(training_clip="ann-run") - cadence.sel(training_clip="ann-walk")
az.summary(contrast.rename("run minus walk, cycles a second").to_dataset(), kind="stats")

# %% [markdown]
# ## Are predictions calibrated? LOO-PIT
#
# Every entry is left out in turn, and asked where it lies in its own predictive distribution. If
# intervals are as wide as they should be these positions are uniform and the curve stays in
# the band. Below we look at two features, of all frames.

# %%
features = [str(name) for name in fit.tree["observed_data"]["y"]["feature"].values[:2]]
left_out = bm.leave_one_out(fit, by="entry", features=features, most=most, seed=0)
_ = az.plot_loo_pit(left_out)
# %% [markdown]
# ## Do the priors matter?
#
# Prior and likelihood are raised to powers near one (Kallioinen et al. 2023). A quantity that moves
# with the prior *and* with the data is one on which the two disagree; one that moves with the prior
# alone has been told by it, not by the recordings. `bm.prior_sensitivity` calls ArviZ's
# `psense_summary` with the joint likelihood of the recordings, which is the right one under a Gaussian
# process; calling it on the tree itself would use another.

# %%
sensitivity = bm.prior_sensitivity(fit)
sensitivity.sort_values("prior", ascending=False).head(8)

# %% [markdown]
# ## Weights of models: stacking
#
# Which mixture of models would predict left-out frames best? `az.loo` and `az.compare` are right on
# the tree as it is, because `log_likelihood` holds the density of every frame given all others.
# `bm.compare` adds the standard error over clips, and sentences.

# %%
plain = bm.fit(bm.Multifactor(residual=bm.White(), factors=()), motion, method=method, seed=0)
comparison = bm.compare({"who and how": fit, "phase alone": plain})
print("\n".join(comparison.sentences))
comparison.table

# %% [markdown]
# ## Prior, posterior and predictive groups
#
# `bm.predictive_groups` adds `prior`, `prior_predictive` and `posterior_predictive`, for
# `az.plot_prior_posterior`, `az.plot_ppc_dist` and others. Here the cumulative distribution of `gamma` before and
# after: the recordings tell it sharply.

# %%
tree = bm.predictive_groups(fit, draws=50)
_ = az.plot_prior_posterior(tree, var_names=["gamma", "beta"])
# %% [markdown]
# ## Draws of what is not identified
#
# To draw a latent space, draws are first brought together: rotated, shifted and rescaled as far as
# the model says that this does not count. That is for pictures; numbers come from `bm.identified`.

# %%
together = bm.aligned(fit)
vectors = together["style_gait"].mean(("chain", "draw"))
bm.plots.styles(vectors.values, [str(one) for one in vectors["level_gait"].values], title="gait")
