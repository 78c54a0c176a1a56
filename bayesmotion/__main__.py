"""The command line as ``python -m bayesmotion``."""

from .cli import app

if __name__ == "__main__":
    app()
