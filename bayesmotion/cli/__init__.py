"""The command line: ``bayesmotion demo``, ``check``, ``fit``, ``diagnose``, ``forecast``, ...

What a command needs is imported when it runs, so that ``--help`` answers at once.
"""

from .app import app
from .calibrating import calibrate
from .criticising import compare, diagnose
from .fitting import check, fit
from .predicting import forecast, synthesize
from .studies import demo, reproduce

COMMANDS = (demo, check, fit, diagnose, compare, calibrate, forecast, synthesize, reproduce)

for command in COMMANDS:
    app.command()(command)

__all__ = ["app"]
