"""Errors that yasps raises about what a user wrote."""


class YaspsError(Exception):
    """Base of every error yasps raises about what a user wrote."""
