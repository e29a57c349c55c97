"""What the model predicts: the nominal model, candidate effects, segments, rollouts of variants."""

from physid.estimation.prediction.candidates import EffectKinds
from physid.estimation.prediction.effect_parameters import EffectParameter
from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.prediction.segments import CutRule, Segmentation
from physid.estimation.prediction.step_effects import AtStep, acts_late, has
from physid.estimation.prediction.timeline import Timeline
from physid.estimation.prediction.variants import Prediction, Variants

__all__ = [
    "AtStep",
    "CutRule",
    "EffectKinds",
    "EffectParameter",
    "NominalModel",
    "Prediction",
    "Predictor",
    "Segmentation",
    "Timeline",
    "Variants",
    "acts_late",
    "has",
]
