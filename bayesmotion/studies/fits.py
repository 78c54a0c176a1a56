"""What studies of one model see of its fits: the class of the model, and that of its data."""

from ..fit import Fit
from ..models.multifactor import Multifactor
from ..models.multifactor.data import PoseData


def multifactor_of(fit: Fit) -> tuple[Multifactor, PoseData]:
    """Return model and training data of a fit of the multifactor model."""
    model, training = fit.model, fit.training
    assert isinstance(model, Multifactor), "the study fits it"
    assert isinstance(training, PoseData), "as it prepares clips"
    return model, training
