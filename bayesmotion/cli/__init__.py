"""The command line: ``bayesmotion demo``, ``check``, ``fit``, ``diagnose``, ``forecast``, ...

What a command needs is imported when it runs, so that ``--help`` answers at once.
"""

from .app import app, fits
from .calibrating import calibrate
from .criticising import compare, diagnose
from .fitting import check
from .predicting import forecast, synthesize
from .studies import demo, reproduce
from .voxels import recognize_pose, voxels

for command in (demo, check):
    app.command()(command)
app.add_typer(fits)
for command in (diagnose, compare, calibrate, forecast, synthesize):
    app.command()(command)
for command in (voxels, recognize_pose, reproduce):
    app.command()(command)

__all__ = ["app"]
