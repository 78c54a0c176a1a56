"""The command line: ``bayesmotion demo``, ``check``, ``fit``, ``forecast``, ...

What a command needs is imported when it runs, so that ``--help`` answers at once.
"""

from .app import app
from .calibrating import calibrate
from .fitting import check, fit
from .predicting import forecast, synthesize
from .studies import demo, reproduce

for command in (demo, check, fit, forecast, synthesize, calibrate, reproduce):
    app.command()(command)

__all__ = ["app"]
