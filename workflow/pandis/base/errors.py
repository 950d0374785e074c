"""The errors that users see."""


class PandisError(Exception):
    """A fault outside the code; the message states what is wrong, where, and what to do.

    A stage that fails with it prints only the message. Any other exception
    is a defect of pandis, and its traceback is printed.
    """


class ReadError(PandisError):
    """A file cannot be read, for a reason that may have passed by the next try."""


class ConfigError(PandisError):
    """A configuration has faults.

    Attributes
    ----------
    faults : dict of str to str
        Messages by dotted path.
    """

    def __init__(self, message: str, faults: dict[str, str]) -> None:
        super().__init__(message)
        self.faults = faults


class RepairError(PandisError):
    """A mesh cannot be repaired as asked.

    Attributes
    ----------
    option : dict
        Options of `mesh` with which to try again; empty if none would help.
    """

    def __init__(self, message: str, **option: object) -> None:
        super().__init__(message)
        self.option = option


class ArtifactError(PandisError):
    """An artifact is missing, damaged or of a kind that its reader does not expect."""
