"""What is wrong with a file or a command line."""


class ConfigError(Exception):
    """A file or a command line is wrong; the message names the file, the line and the mend."""
