"""The command line: ``bayesmotion demo``, ``check``, ``fit``, ``diagnose``, ``forecast``, ...

What a command needs is imported when it runs, so that ``--help`` answers at once.
"""

from .app import app, fits
from .benchmarking import bench
from .calibrating import calibrate
from .checking import check
from .contrasting import contrast
from .criticising import compare, diagnose, loo, report
from .denoising import denoise, fill_gaps
from .forecasting import forecast
from .gait import filter, reconstruct
from .outputs import checked
from .portraits import portrait
from .predicting import synthesize
from .recognising import keyposes, recognize
from .speaking import speak
from .studies import demo, reproduce
from .viewing import view
from .voxels import recognize_pose, voxels

for command in (demo, check, view):
    app.command()(checked(command))
app.add_typer(fits)
COMMANDS = (
    diagnose, loo, compare, report, calibrate, forecast, synthesize, keyposes, recognize,
    reconstruct, denoise, fill_gaps, contrast, filter, voxels, recognize_pose, portrait, speak,
    reproduce, bench,
)  # fmt: skip
for command in COMMANDS:
    app.command()(checked(command))

__all__ = ["app"]
