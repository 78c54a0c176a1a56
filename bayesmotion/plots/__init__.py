"""Pictures of motion and of what models make of it, without pyplot.

Functions give the Figure or Axes they drew on; `save` writes either to a file.
"""

from .chains import chains_plot
from .checks import checks_plot
from .comparison import comparison_plot
from .forecast import forecast_errors, forecast_plot
from .keyposes import keyposes_plot
from .latent import content_path, phase_plot, styles
from .latent_space import latent_space
from .stick import compare, grid, stick_figures
from .style import save
from .surface import confidence, surfaces

__all__ = [
    "chains_plot",
    "checks_plot",
    "compare",
    "comparison_plot",
    "confidence",
    "content_path",
    "forecast_errors",
    "forecast_plot",
    "grid",
    "keyposes_plot",
    "latent_space",
    "phase_plot",
    "save",
    "stick_figures",
    "styles",
    "surfaces",
]
