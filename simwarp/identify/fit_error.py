"""The error of a fit that cannot be made."""


class FitError(ValueError):
    """Names the file and the key, the rule, the value that was received and the remedy, in one line."""
