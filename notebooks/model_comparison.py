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
# # Comparing models
#
# A script to copy: the same recordings, several models, three questions. What is left out decides
# what the answer means.
#
# | left out | asks |
# | --- | --- |
# | a frame | do you fill in a frame between its neighbours? |
# | a clip | do you know how this person does it, from their other clips? |
# | a person | do you know people you have never seen? |

# %% tags=["parameters"]
max_steps = 400
initial = 2
leave_out_people = True

# %%
import bayesmotion as bm

motion = bm.synthetic_walkers(
    ("ann", "ben", "cas"), ("walk", "run"), seconds=1.2, frame_rate=15.0, seed=1
)
models = {
    "who and how": bm.Multifactor(residual=bm.White()),
    "how alone": bm.Multifactor(residual=bm.White(), factors=("gait",)),
    "phase alone": bm.Multifactor(residual=bm.White(), factors=()),
}
method = bm.MAP(initial=initial, max_steps=max_steps)
fits = {name: bm.fit(model, motion, method=method, seed=0) for name, model in models.items()}
for name, fit in fits.items():
    print(f"{name}: converged {bool(fit.stats()['converged'])}, {fit.stats()['steps']:.0f} steps")

# %% [markdown]
# ## Frames left out
#
# The elpd is the log density that a model gives to what was left out, added up: higher is better. Only
# differences count, and only if they are larger than 4 and than two standard errors. These fits are
# points, so their parameters have seen the frame that is left out, and the sentences say so.

# %%
by_frame = bm.compare(fits)
print("\n".join(by_frame.sentences))
by_frame.table

# %% [markdown]
# ## People left out
#
# Every model is fitted again without each person, and then sees that person's clips. This is the
# question to ask before a model is used on new people, and its answer can be another one: what
# a frame's neighbours tell is of no help here.

# %%
two = {name: fits[name] for name in ("who and how", "phase alone")}
by_person = bm.compare(two, by="subject") if leave_out_people else by_frame
print("\n".join(by_person.sentences))
by_person.table

# %% [markdown]
# ## As a picture
#
# The difference from the best model, with the larger of its standard errors (over frames, over
# clips: neighbouring frames are alike, so the first is too small).

# %%
columns = ("elpd_diff", "dse", "dse_clips")
rows = [
    {"fit": name, **{key: float(row[key]) for key in columns}}
    for name, row in by_frame.table.iterrows()
]
bm.plots.comparison_plot(rows)

# %% [markdown]
# ## How to read it
#
# - **Weights** (stacking) are those with which the predictions would be mixed to predict best. They
#   are not probabilities of being true.
# - **Pareto k** above 0.7 says that draws made with all data cannot stand for draws without the point.
#   `bm.compare(..., by="clip")` refits instead, and needs no k.
# - Two models may predict alike and mean different things: compare on what you will use them for.
#
# [Trusting and comparing fits](../docs/criticism.md) has the whole of it.
