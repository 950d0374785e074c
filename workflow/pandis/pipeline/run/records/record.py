"""Records: what stands among the attributes of an artifact, by the names of fields.

A record is written by one stage and read by others. Its class, in the room of the stage that writes
it, is the one place that names what is in it.
"""

from pydantic import BaseModel, ConfigDict, ValidationError

from pandis.base.errors import ArtifactError


class Record(BaseModel):
    """Base of all records. What else stands among the attributes is passed over."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    @classmethod
    def of(cls, artifact):
        """Return the record among the attributes of a `pandis.pipeline.run.job.artifact.Artifact`.

        Raises
        ------
        ArtifactError
            Another version of pandis has written them.
        """
        return cls.checked(artifact, artifact.attributes)

    @classmethod
    def checked(cls, artifact, values):
        """Return the record of values that stand somewhere among an artifact's attributes."""
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise ArtifactError(
                f"{artifact.path}: not of this version of pandis ({error.error_count()} attributes "
                "are missing or of another kind); run the workflow again"
            ) from error

    def attributes(self):
        """Return the record as plain attributes."""
        return self.model_dump()
