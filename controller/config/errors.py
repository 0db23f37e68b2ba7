"""The error for a wrong file or command line."""


class ConfigError(Exception):
    """A file or a command line is wrong; the message names file and line and what to do."""
