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
# # A model of your own
#
# A model is one class: a frozen dataclass of settings with a handful of verbs. This notebook writes a small one,
# *joint angles as a sum of harmonics of one phase*, and hands it to the library, which then fits it by MAP,
# NUTS and an ensemble, saves it, predicts with it, diagnoses it and compares it. [Adding a
# model](../docs/adding-a-model.md) lists all verbs; its example has one harmonic, this one has a setting for
# how many.
#
# ## What the model says
#
# $$y_{nd}=\mu_d+\sum_{k=1}^{K}\bigl(a_{kd}\cos k\theta_n+b_{kd}\sin k\theta_n\bigr)+\mathrm{noise}_d,\qquad
# \theta_n=\phi+\Delta\,n$$
#
# The phase of the training clip is zero, because a shift of it could be undone by turning all $(a, b)$; that is a
# matter of identifiability, and belongs into the model.

# %% tags=["parameters"]
warmup, draws, chains = 500, 1000, 4
contract = True

# %%
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import numpyro
import xarray as xr
from numpyro import distributions as dist

import bayesmotion as bm


class Angles(NamedTuple):
    """y (N, D), zero where missing; seen (N, D); frame (N,)."""

    y: jax.Array
    seen: jax.Array
    frame: jax.Array


@dataclass(frozen=True)
class AngleRecording:
    """A recording as the program sees it."""

    angles: Angles
    features: tuple[str, ...]

    @property
    def data(self):
        """Arrays of the program."""
        return (self.angles,)

    def observed(self):
        """What was recorded, NaN where missing."""
        y = np.where(self.angles.seen, self.angles.y, np.nan)
        return xr.Dataset({"y": (("frame", "feature"), y)}, {"feature": list(self.features)})

    def constants(self):
        """Nothing beside."""
        return xr.Dataset()

    def units(self):
        """Angles are in degrees as they are."""
        d = len(self.features)
        return {"y": bm.Units(np.zeros(d), np.ones(d))}


class Trained(NamedTuple):
    """level (D,), waves (2K, D) and noise (D,) of one draw."""

    level: jax.Array
    waves: jax.Array
    noise: jax.Array


# %% [markdown]
# ## The class
#
# `program` is the generative model in NumPyro, and the only place where priors stand. With `trained` the same
# program is that of a new clip. `identified` says what data can tell: here the size of every harmonic, which
# no shift of the phase changes.


# %%
@dataclass(frozen=True)
class Harmonics:
    """Joint angles as harmonics of a phase.

    Parameters
    ----------
    count
        K, how many harmonics.
    period_frames
        Prior median of the length of a cycle, in frames.
    """

    count: int = 2
    period_frames: float = 20.0

    name: ClassVar[str] = "harmonics"
    about: ClassVar[bm.About] = bm.About("", "y (frame, feature)")

    @classmethod
    def example(cls, seed=0):
        """Return the model, and angles of a hip and a knee over three cycles."""
        random = np.random.default_rng(seed)
        theta = 2.0 * np.pi / 19.0 * np.arange(60)[:, None]
        y = np.array([10.0, 25.0]) + 20.0 * np.cos(theta) * [1.0, 0.6]
        y = y + 12.0 * np.sin(2 * theta) * [0.1, 1.0] + 1.5 * random.normal(size=y.shape)
        return cls(), xr.Dataset({"y": (("frame", "feature"), y)}, {"feature": ["hip", "knee"]})

    def prepare(self, recordings, trained=None):
        """Make a recording into arrays."""
        y = np.asarray(recordings["y"].values, float)
        made = Angles(np.nan_to_num(y), np.isfinite(y), np.arange(len(y), dtype=float))
        return AngleRecording(made, tuple(map(str, recordings["feature"].values)))

    def program(self, data, trained=None):
        """Generate the angles."""
        if trained is None:
            d = data.y.shape[1]
            level = numpyro.sample("level", dist.Normal(0.0, 50.0).expand([d]).to_event(1))
            waves = dist.Normal(0.0, 30.0).expand([2 * self.count, d]).to_event(2)
            noise = dist.HalfNormal(10.0).expand([d]).to_event(1)
            trained = Trained(level, numpyro.sample("waves", waves), numpyro.sample("noise", noise))
            phase = 0.0
        else:
            phase = numpyro.sample("phase", dist.VonMises(0.0, 1e-3))
        pace = numpyro.sample("pace", dist.LogNormal(jnp.log(2 * jnp.pi / self.period_frames), 0.2))
        mean = self._mean(trained, phase + pace * data.frame)
        entries = dist.Normal(mean, trained.noise).mask(data.seen).to_event(2)
        numpyro.sample("y", entries, obs=data.y)

    def _basis(self, theta):
        k = jnp.arange(1, self.count + 1)
        return jnp.concatenate([jnp.cos(theta[:, None] * k), jnp.sin(theta[:, None] * k)], axis=1)

    def _mean(self, trained, theta):
        return trained.level + self._basis(jnp.asarray(theta)) @ trained.waves

    def initial_values(self, data, seed, count, trained=None):
        """Return where the search begins: a few paces, and least squares at each."""
        paces = 2 * np.pi / self.period_frames * np.linspace(0.8, 1.2, max(count, 5))
        if trained is not None:
            phases = np.linspace(-np.pi, np.pi, 8, endpoint=False) + np.pi / 8
            return [{"phase": np.array(a), "pace": np.array(p)} for p in paces[:3] for a in phases]
        found = []
        for pace in paces:
            basis = np.asarray(self._basis(jnp.asarray(pace * data.angles.frame)))
            basis = np.column_stack([np.ones(len(basis)), basis])
            weights = np.linalg.lstsq(basis, data.angles.y, rcond=None)[0]
            noise = np.maximum(np.std(data.angles.y - basis @ weights, axis=0), 0.1)
            values = {"level": weights[0], "waves": weights[1:], "noise": noise}
            found.append(values | {"pace": np.array(pace)})
        return found

    def condition(self, data, values):
        """Return the trained model, for one draw."""
        return Trained(values["level"], values["waves"], values["noise"])

    def predict(self, trained, data, values):
        """Return what every entry is told to be."""
        mean = self._mean(trained, values["phase"] + values["pace"] * data.frame)
        return {"y": bm.IndependentNormal(mean, jnp.broadcast_to(trained.noise**2, mean.shape))}

    def identified(self, data, values):
        """Return what data can tell."""
        cosine, sine = jnp.split(values["waves"], 2)
        kept = {name: values[name] for name in ("level", "noise", "pace")}
        return kept | {"amplitude": jnp.hypot(cosine, sine)}

    def pointwise(self, data, values):
        """Return log p of every frame given all others: frames are independent here."""
        mean = self._mean(self.condition(data, values), values["pace"] * data.frame)
        each = dist.Normal(mean, values["noise"]).log_prob(data.y)
        return jnp.sum(jnp.where(data.seen, each, 0.0), axis=1)

    def points(self, data):
        """Return what these points are."""
        return {"frame": ("point", np.arange(len(data.angles.y)))}

    def dims(self):
        """Return the dimensions of all sites."""
        each = dict.fromkeys(("level", "noise"), ("feature",))
        return each | {"y": ("frame", "feature"), "pace": (), "waves": ("wave", "feature"),
                       "amplitude": ("harmonic", "feature")}  # fmt: skip

    def coords(self, data):
        """Return the labels of the dimensions."""
        k = range(1, self.count + 1)
        waves = [f"cos {i}" for i in k] + [f"sin {i}" for i in k]
        return {"feature": list(data.features), "frame": list(range(len(data.angles.y))),
                "wave": waves, "harmonic": list(k)}  # fmt: skip

    def sbc_case(self):
        """Return a small instance, for calibration."""
        data = Angles(np.zeros((12, 2)), np.ones((12, 2), bool), np.arange(12.0))
        noise = (("noise", "sd"),)
        return bm.SBCCase(self, draw, shuffle, Harmonics.identified, "pace", noise), data


def draw(model, key, data):
    """Draw all sites and outcomes."""
    values = bm.draw_sites(model, key, data)
    return values, data._replace(y=values.pop("y"))


def shuffle(key, data):
    """Make a fault that calibration must find: rows in another order."""
    return data._replace(y=jax.random.permutation(key, data.y))


_ = bm.register(Harmonics)
# %% [markdown]
# ## Everything works on it
#
# Fits of one, two and three harmonics: the knee bends twice a cycle, so one is too few, and a third
# explains nothing.

# %%
model, recordings = bm.example("harmonics")
method = bm.NUTS(warmup=warmup, draws=draws, chains=chains)
fits = {
    f"{count} harmonics": bm.fit(Harmonics(count), recordings, method=method, seed=0)
    for count in (1, 2, 3)
}
fit = fits["2 harmonics"]
bm.diagnose(fit)

# %%
comparison = bm.compare(fits)
print("\n".join(comparison.sentences))
comparison.table

# %% [markdown]
# ## Predict
#
# A new clip begins anywhere in the cycle, and half of it is missing (NaN). Its phase and pace are found; what is
# missing is predicted with how sure that is.

# %%
_, new = bm.example("harmonics", seed=1)
new = new.isel(frame=slice(7, 47))
half = new.copy(deep=True)
half["y"][20:] = np.nan
found = bm.predict(fit, half).site()
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7, 3.6), layout="constrained")
for i, ax in enumerate(axes):
    low, high = found.quantile(0.05)[:, i], found.quantile(0.95)[:, i]
    ax.axvspan(0, 19, color="#EFEFEF", label="given")
    ax.fill_between(range(len(low)), low, high, color="#CFE3F2", label="90 % interval")
    ax.plot(found.means()[:, i], color="#0072B2", label="predicted")
    ax.plot(new["y"].values[:, i], "k.", label="recorded")
    ax.set_ylabel(f"{new['feature'].values[i]}, degrees")
labelled = axes[0].get_legend_handles_labels()
figure.legend(*labelled, loc="outside upper center", ncols=4, fontsize="small")
_ = axes[-1].set_xlabel("frame")
# %% [markdown]
# ## The contract
#
# `bm.check_model` runs what all models of the library promise on yours, and names the verb that breaks it:
# missing entries, saving and loading, averaging over draws in any order, leaving out as refitting does, and
# more. It takes a minute or two.

# %%
if contract:
    bm.check_model(Harmonics)
    print("kept")

# %% [markdown]
# To share it, make it an entry point of the group `bayesmotion.models` in your package; see [adding a
# model](../docs/adding-a-model.md).
