"""Bayesian models of human motion.

>>> import bayesmotion as bm
>>> model, recordings = bm.example("multifactor")
>>> fit = bm.fit(model, recordings, method=bm.MAP(max_steps=50), seed=0)

All that users need is a name of this package; each is imported when it is first asked for.
"""

import importlib
import sys
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

from platformdirs import user_cache_path

from .numerics import double_precision, keep_programs, one_blas_thread

one_blas_thread()
double_precision()
keep_programs(user_cache_path("bayesmotion") / "programs")

__version__ = "0.1.0"

if TYPE_CHECKING:
    from . import plots
    from .catalogue import example, models
    from .errors import InputError, MotionWarning, NumericalError
    from .evaluate.alignment import aligned
    from .evaluate.checks import predictive_check, predictive_groups, prior_sensitivity
    from .evaluate.compare import compare
    from .evaluate.contract import check_model
    from .evaluate.diagnostics import diagnose
    from .evaluate.identified import identified
    from .evaluate.loo import leave_one_out
    from .evaluate.sbc.calibration import calibrate
    from .evaluate.sbc.rank_test import rank_test
    from .fit import Fit, load
    from .inference.methods import EM, MAP, NUTS, Ensemble, FastMarginal, LocalLearning, fit
    from .inference.predicting import Prediction, predict
    from .model import About, Model, PointEstimate, SBCCase, Units, draw_sites
    from .models.gait_pose import (
        Cylinder,
        GaitPose,
        NoSurface,
        OnCylinder,
        OnTorus,
        PathDynamics,
        PoseCircle,
        Torus,
    )
    from .models.keyposes import Keyposes
    from .models.motion_tensor import MotionTensor
    from .models.multifactor import OU, Circle, Factor, GPDynamics, Multifactor, White
    from .models.shared_gplvm import (
        MLP,
        RBF,
        BackConstraint,
        ContextWindow,
        Dynamics,
        Identity,
        Inducing,
        Linear,
        SharedGPLVM,
    )
    from .models.voice_puppetry import VoicePuppetry
    from .models.voxel_pose import MixturePPCA, RelevanceVectors, VoxelPose, voxel_recordings
    from .motion import (
        check,
        clips,
        concat,
        cycles_of,
        describe,
        downsample,
        drop,
        joint_roles,
        read,
        resample,
        split,
        with_joints,
        with_labels,
        write,
    )
    from .motion.datasets.public import cmu, hdm05
    from .motion.io.curves import read_curves
    from .motion.segments import Segmenting
    from .motion.stride_curves import curves_of
    from .motion.synthetic.dance import synthetic_dance
    from .motion.synthetic.walkers import synthetic_truth, synthetic_walkers
    from .plots import forecast_plot, stick_figures
    from .prediction import (
        Bernoulli,
        GPPredictive,
        IndependentNormal,
        Mixture,
        Predictive,
        Scores,
        score,
    )
    from .registry import register
    from .report.writing import Report, report
    from .sensing.audio.cepstra import mfcc, read_audio
    from .sensing.face.appearance import fit_appearance
    from .sensing.face.landmarks import read_landmarks, track_landmarks
    from .sensing.face.search import train_search
    from .sensing.face.talker import synthetic_talker
    from .sensing.face.video import read_video
    from .sensing.face.views import views_of
    from .sensing.voxels.shape_context import ShapeContext
    from .tasks.contrast import Contrast, contrast
    from .tasks.denoise import denoise
    from .tasks.forecast import Forecast, forecast
    from .tasks.forecast_scores import ForecastScores, forecast_picture, forecast_scores
    from .tasks.gaps import FilledGaps, fill_gaps
    from .tasks.keyposes import keyposes_of
    from .tasks.norm import Norm, norm
    from .tasks.online import Online, OnlineForecast, online
    from .tasks.power import Power, power
    from .tasks.recognize import recognize
    from .tasks.recognize_pose import RecognizedPoses, recognize_pose
    from .tasks.reconstruct import Reconstruction, reconstruct
    from .tasks.recording import Denoised
    from .tasks.speech import audio_to_face
    from .tasks.speech_files import speak_file, write_tracks
    from .tasks.synthesise import Synthesis, synthesize, transition
    from .view.viewer import View, view

# Public names by the module that has them.
_PUBLIC: dict[str, tuple[str, ...]] = {
    "catalogue": (
        "example",
        "models",
    ),
    "evaluate.alignment": ("aligned",),
    "evaluate.sbc.calibration": ("calibrate",),
    "evaluate.checks": (
        "predictive_check",
        "predictive_groups",
        "prior_sensitivity",
    ),
    "evaluate.compare": ("compare",),
    "evaluate.contract": ("check_model",),
    "evaluate.diagnostics": ("diagnose",),
    "evaluate.identified": ("identified",),
    "evaluate.loo": ("leave_one_out",),
    "evaluate.sbc.rank_test": ("rank_test",),
    "errors": (
        "InputError",
        "MotionWarning",
        "NumericalError",
    ),
    "fit": (
        "Fit",
        "load",
    ),
    "inference.methods": (
        "EM",
        "MAP",
        "NUTS",
        "Ensemble",
        "FastMarginal",
        "LocalLearning",
        "fit",
    ),
    "inference.predicting": (
        "Prediction",
        "predict",
    ),
    "registry": ("register",),
    "report.writing": (
        "Report",
        "report",
    ),
    "model": (
        "About",
        "Model",
        "PointEstimate",
        "SBCCase",
        "Units",
        "draw_sites",
    ),
    "models.gait_pose": (
        "Cylinder",
        "GaitPose",
        "NoSurface",
        "OnCylinder",
        "OnTorus",
        "PathDynamics",
        "PoseCircle",
        "Torus",
    ),
    "models.keyposes": ("Keyposes",),
    "models.motion_tensor": ("MotionTensor",),
    "models.multifactor": (
        "OU",
        "Circle",
        "Factor",
        "GPDynamics",
        "Multifactor",
        "White",
    ),
    "models.shared_gplvm": (
        "MLP",
        "RBF",
        "BackConstraint",
        "ContextWindow",
        "Dynamics",
        "Identity",
        "Inducing",
        "Linear",
        "SharedGPLVM",
    ),
    "models.voice_puppetry": ("VoicePuppetry",),
    "models.voxel_pose": (
        "MixturePPCA",
        "RelevanceVectors",
        "VoxelPose",
        "voxel_recordings",
    ),
    "motion": (
        "check",
        "clips",
        "concat",
        "cycles_of",
        "describe",
        "downsample",
        "drop",
        "joint_roles",
        "read",
        "resample",
        "split",
        "with_joints",
        "with_labels",
        "write",
    ),
    "motion.datasets.public": (
        "cmu",
        "hdm05",
    ),
    "motion.io.curves": ("read_curves",),
    "motion.segments": ("Segmenting",),
    "motion.stride_curves": ("curves_of",),
    "motion.synthetic.walkers": (
        "synthetic_truth",
        "synthetic_walkers",
    ),
    "motion.synthetic.dance": ("synthetic_dance",),
    "plots": (
        "forecast_plot",
        "stick_figures",
    ),
    "prediction": (
        "Bernoulli",
        "GPPredictive",
        "IndependentNormal",
        "Mixture",
        "Predictive",
        "Scores",
        "score",
    ),
    "sensing.audio.cepstra": (
        "mfcc",
        "read_audio",
    ),
    "sensing.face.appearance": ("fit_appearance",),
    "sensing.face.search": ("train_search",),
    "sensing.face.landmarks": (
        "read_landmarks",
        "track_landmarks",
    ),
    "sensing.voxels.shape_context": ("ShapeContext",),
    "sensing.face.talker": ("synthetic_talker",),
    "sensing.face.video": ("read_video",),
    "sensing.face.views": ("views_of",),
    "tasks.contrast": (
        "Contrast",
        "contrast",
    ),
    "tasks.denoise": ("denoise",),
    "tasks.gaps": (
        "FilledGaps",
        "fill_gaps",
    ),
    "tasks.forecast": (
        "Forecast",
        "forecast",
    ),
    "tasks.keyposes": ("keyposes_of",),
    "tasks.online": (
        "Online",
        "OnlineForecast",
        "online",
    ),
    "tasks.recognize": ("recognize",),
    "tasks.recognize_pose": (
        "RecognizedPoses",
        "recognize_pose",
    ),
    "tasks.norm": (
        "Norm",
        "norm",
    ),
    "tasks.power": (
        "Power",
        "power",
    ),
    "tasks.reconstruct": (
        "Reconstruction",
        "reconstruct",
    ),
    "tasks.recording": ("Denoised",),
    "tasks.forecast_scores": (
        "ForecastScores",
        "forecast_picture",
        "forecast_scores",
    ),
    "tasks.speech": ("audio_to_face",),
    "tasks.speech_files": (
        "speak_file",
        "write_tracks",
    ),
    "tasks.synthesise": (
        "Synthesis",
        "synthesize",
        "transition",
    ),
    "view.viewer": (
        "View",
        "view",
    ),
}
# Modules that are public as they are.
_MODULES = ("plots",)
_WHERE = {name: module for module, names in _PUBLIC.items() for name in names}

__all__ = sorted([*_WHERE, *_MODULES])  # pyright: ignore[reportUnsupportedDunderAll]


@cache
def _public(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f".{name}", __name__)
    return getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)


class _Package(ModuleType):
    """The package as users see it: a public name is itself, whatever module is called so too."""

    def __getattribute__(self, name: str) -> Any:
        """Import a public name when it is first asked for: reading files needs no sampler."""
        public = name in _WHERE or name in _MODULES
        return _public(name) if public else super().__getattribute__(name)

    def __dir__(self) -> list[str]:
        """Return the public names."""
        return __all__


sys.modules[__name__].__class__ = _Package
