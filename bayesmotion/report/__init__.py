"""What a fit says and how far it is to be trusted, on one page."""

from .writing import Report, report

__all__ = ["Report", "report"]
