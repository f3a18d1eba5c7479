"""Document data of a campaign: title block, margin policy, time windows around events."""

from pydantic import Field, ValidationInfo, field_validator

from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.quantities import units
from lvnav_trade.quantities.errors import quoted


class Window(units.Card):
    """Time around the event of a requirement in which the report looks for the worst error."""

    before: units.Duration = Field(5.0, ge=0, description="start of the window before the event")
    after: units.Duration = Field(20.0, ge=0, description="end of the window after the event, at most that of the run")


class Document(units.Card):
    """Title block of the report."""

    title: str | None = Field(None, description="title of the report; the name of the campaign if absent")
    author: str | None = Field(None, description="author or responsible engineer")
    issue: str | None = Field(None, description="issue and revision, such as 1.2")
    classification: str | None = Field(None, description="marking or distribution statement")


class MarginPolicy(units.Card):
    """Margin to the limits of requirements that each phase of the project requires."""

    phase: str = Field(description="the present phase, such as PDR")
    required: dict[str, units.Fraction] = Field(
        min_length=1, description="required margin by phase, such as {PDR: '20 %', CDR: '10 %'}"
    )

    @field_validator("required")
    @classmethod
    def _check_margins(cls, margins: dict[str, float], info: ValidationInfo) -> dict[str, float]:
        for phase, margin in margins.items():
            if margin >= 1.0:
                raise ValueError(f"{phase}: a margin of {100.0 * margin:g} % leaves no error; it should be below 100 %")
        present_phase = info.data.get("phase")
        if present_phase is not None and present_phase not in margins:
            raise ValueError(f"no margin for the phase {quoted(present_phase)}{hint(present_phase, list(margins))}")
        return margins
