"""The command line: ``bayesmotion demo``, ``check``, ``fit``, ``diagnose``, ``forecast``, ...

What a command needs is imported when it runs, so that ``--help`` answers at once.
"""

from .app import app
from .criticising import compare, diagnose
from .fitting import check, fit
from .predicting import forecast, synthesize
from .studies import demo, reproduce

for command in (demo, check, fit, diagnose, compare, forecast, synthesize, reproduce):
    app.command()(command)

__all__ = ["app"]
