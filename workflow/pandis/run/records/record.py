"""Records: what stands among the attributes of an artifact, by the names of fields.

A record is written by one stage and read by others. Its class, in the room of the stage that writes
it, is the one place that names what is in it.
"""

from pydantic import BaseModel, ConfigDict


class Record(BaseModel):
    """Base of all records. What else stands among the attributes is passed over."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    @classmethod
    def of(cls, artifact):
        """Return the record among the attributes of a `pandis.run.artifact.Artifact`."""
        return cls.model_validate(artifact.attributes)

    def attributes(self):
        """Return the record as plain attributes."""
        return self.model_dump()
