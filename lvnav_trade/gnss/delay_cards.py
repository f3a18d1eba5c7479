"""Cards of the tropospheric and ionospheric models, of the true atmosphere, and of the filter's corrections."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from lvnav_trade.quantities.units import (
    Angle,
    Card,
    ElectronContent,
    Fraction,
    Length,
    Pause,
    Pressure,
    ScaleHeight,
    Temperature,
    TimeConstant,
)

# --- refractivity of the ray-traced troposphere -----------------------------------------------------------------------


class StandardProfile(Card):
    """US Standard Atmosphere 1976, with vapour that falls off exponentially (default: ITU-R P.835, 7.5 g/m^3)."""

    kind: Literal["standard"] = "standard"
    wet: float = Field(44.8, ge=0.0, description="wet refractivity at sea level, (n - 1) x 1e6")
    wet_scale_height: ScaleHeight = 2000.0

    def _faults(self) -> Iterator[str]:
        if self.wet / self.wet_scale_height > 0.05:
            yield "wet / wet_scale_height should be at most 50 per km: vapour that falls faster traps rays"


class BeanThayerProfile(Card):
    """Exponential reference atmosphere of Bean and Thayer (1959), with 324.8 that of NATO STANAG 4294."""

    kind: Literal["bean_thayer"] = "bean_thayer"
    surface: float = Field(324.8, ge=200.0, le=450.0, description="refractivity at sea level, (n - 1) x 1e6")


class ExponentialProfile(Card):
    """One exponential; default: mean of the world, ITU-R P.453."""

    kind: Literal["exponential"] = "exponential"
    surface: float = Field(315.0, gt=0.0, le=450.0, description="refractivity at sea level, (n - 1) x 1e6")
    scale_height: Annotated[ScaleHeight, Field(ge=5000.0)] = 7350.0


RefractivityProfile = Annotated[StandardProfile | BeanThayerProfile | ExponentialProfile, Field(discriminator="kind")]

# --- troposphere ------------------------------------------------------------------------------------------------------


class NoTroposphere(Card):
    """No tropospheric delay."""

    kind: Literal["none"] = "none"


class RayTracedTroposphere(Card):
    """Rays traced through layered air, bending included: any height, any elevation."""

    kind: Literal["ray_traced"] = "ray_traced"
    profile: RefractivityProfile = StandardProfile()
    satellite_radius: Annotated[Length, Field(ge=12e6)] = Field(
        26.56e6, description="radius of the satellite orbits; 10 % more adds 1 % to grazing rays and nothing to others"
    )


class AnyElevationTroposphere(Card):
    """Canepa and Servidia, eq. 3.1 to 3.15: one formula for every height, negative elevations included."""

    kind: Literal["any_elevation"] = "any_elevation"
    gain: Length = Field(2.47, description="k_alpha of eq. 3.1")
    scale_height: ScaleHeight = Field(7518.8, description="h_tau of eq. 3.1")
    offset: float = Field(0.0121, gt=0.0, description="phi_alpha of eq. 3.1")
    join: Angle = Field(0.08726646259971647, gt=0.0, description="elevation below which eq. 3.3 holds, 5 deg")
    gain_law: bool = Field(True, description="gain that depends on height and elevation, eq. 3.14 and 3.15")


class SpilkerTroposphere(Card):
    """Spilker's simple model: Trigo and Theil, eq. 16 to 18."""

    kind: Literal["spilker"] = "spilker"
    zenith: Length = Field(2.4405, description="at sea level")
    scale_height: ScaleHeight = Field(1e3 / 0.133, description="eq. 18 prints 0.133e-3 per m")
    offset: float = Field(0.0121, gt=0.0)
    lowest: Angle = Field(
        0.08726646259971647, ge=0.0, description="lowest elevation, below which its value is used; 5 deg"
    )


class StanagTroposphere(Card):
    """NATO STANAG 4294, as signal simulators have it: zenith delay of its refractivity, with its mapping function."""

    kind: Literal["stanag"] = "stanag"
    surface: float = Field(324.8, ge=200.0, le=450.0, description="refractivity at sea level, (n - 1) x 1e6")
    lowest: Angle = Field(0.0, ge=0.0, description="lowest elevation, below which its value is used")


class _Weather(Card):
    """Weather at sea level, standard lapse above."""

    pressure: Pressure = 101325.0
    temperature: Annotated[Temperature, Field(ge=200.0)] = 288.15
    humidity: Annotated[Fraction, Field(le=1.0)] = 0.5
    lowest: Angle = Field(
        0.05235987755982989, gt=0.0, description="lowest elevation, below which its value is used; 3 deg"
    )


class SaastamoinenTroposphere(_Weather):
    """Saastamoinen's zenith delay over the sine of elevation; above 11 km it falls smoothly to zero."""

    kind: Literal["saastamoinen"] = "saastamoinen"


class NiellTroposphere(_Weather):
    """Saastamoinen's zenith delay with Niell's mapping functions, by latitude, height and day of the year."""

    kind: Literal["niell"] = "niell"


_Troposphere = (
    NoTroposphere
    | RayTracedTroposphere
    | AnyElevationTroposphere
    | SpilkerTroposphere
    | StanagTroposphere
    | SaastamoinenTroposphere
    | NiellTroposphere
)
TroposphereModel = Annotated[_Troposphere, Field(discriminator="kind")]

# --- ionosphere -------------------------------------------------------------------------------------------------------


class NoIonosphere(Card):
    """No ionospheric delay."""

    kind: Literal["none"] = "none"


class KlobucharIonosphere(Card):
    """Broadcast model (IS-GPS-200, 20.3.3.5.2.5): by place and time of day, blind to the receiver's height."""

    kind: Literal["klobuchar"] = "klobuchar"
    alpha: tuple[float, float, float, float] = Field(description="s, s per semicircle, and so on, as broadcast")
    beta: tuple[float, float, float, float] = Field(description="s, s per semicircle, and so on, as broadcast")


class _Chapman(Card):
    """Chapman layer, with the content above the receiver: Trigo and Theil, eq. 19 to 22."""

    peak: ScaleHeight = Field(420e3, description="h0 of eq. 21")
    scale_height: ScaleHeight = Field(100e3, description="H of eq. 21")
    slant: Literal["lear", "integrated"] = Field(
        "lear", description="mapping of eq. 22 at the median of the content above, or integral along the ray"
    )


class ContentIonosphere(_Chapman):
    """Chapman layer of a constant content at the ground: Trigo and Theil, eq. 19 to 22."""

    kind: Literal["content"] = "content"
    vertical: ElectronContent = Field(20e16, description="at the ground; 20 TECU in section 5.2.3")


class KlobucharContentIonosphere(_Chapman):
    """Chapman layer whose content at the ground is that of the broadcast model below the ionospheric point: Trigo and
    Theil, section 5.2.3.
    """

    kind: Literal["klobuchar_content"] = "klobuchar_content"
    alpha: tuple[float, float, float, float] = Field(description="s, s per semicircle, and so on, as broadcast")
    beta: tuple[float, float, float, float] = Field(description="s, s per semicircle, and so on, as broadcast")


class EpsteinIonosphere(Card):
    """Two half Epstein layers, thinner below the peak than above it, integrated along the ray."""

    kind: Literal["epstein"] = "epstein"
    vertical: ElectronContent = Field(20e16, description="at the ground")
    peak: ScaleHeight = 350e3
    bottom: ScaleHeight = Field(40e3, description="thickness below the peak")
    top: ScaleHeight = Field(90e3, description="thickness above the peak")

    def _faults(self) -> Iterator[str]:
        if self.peak < 4.0 * self.bottom:
            yield "peak should be at least four times the thickness below it: the layer ends above the ground"


_Ionosphere = NoIonosphere | KlobucharIonosphere | ContentIonosphere | KlobucharContentIonosphere | EpsteinIonosphere
IonosphereModel = Annotated[_Ionosphere, Field(discriminator="kind")]

# --- truth and corrections --------------------------------------------------------------------------------------------


class AtmosphereCard(Card):
    """The true atmosphere: models of troposphere and ionosphere, and the variation of the delays between runs.

    The delay in a run is that of the model times (1 + scale). The scale is the same for all satellites. It is constant
    in a run, or a Gauss-Markov process if a time constant is given.
    """

    troposphere: TroposphereModel = NoTroposphere()
    ionosphere: IonosphereModel = NoIonosphere()
    troposphere_scale: Fraction = Field(0.0, description="one sigma of the true delay's relative error")
    troposphere_scale_time: TimeConstant | None = Field(
        None, description="time constant of its variation; none: constant in a run"
    )
    ionosphere_scale: Fraction = Field(0.0, description="one sigma of the true delay's relative error")
    ionosphere_scale_time: TimeConstant | None = Field(
        None, description="time constant of its variation; none: constant in a run"
    )


class MatchedCorrection(Card):
    """Correction by the model of the true atmosphere."""

    kind: Literal["matched"] = "matched"


class CorrectionsCard(Card):
    """Corrections subtracted from the measurements before the filter processes them; `matched` uses the true model."""

    troposphere: Annotated[_Troposphere | MatchedCorrection, Field(discriminator="kind")] = NoTroposphere()
    ionosphere: Annotated[_Ionosphere | MatchedCorrection, Field(discriminator="kind")] = NoIonosphere()
    relativity: bool = Field(
        False, description="correct the periodic relativistic term of the satellite clocks, from position and velocity"
    )
    doppler_interval: Literal["matched"] | Pause = Field(
        0.0,
        description="interval over which the filter models range rates as means; 0: instantaneous; matched: the true "
        "one",
    )


def correction_models(
    corrections: CorrectionsCard, atmosphere: AtmosphereCard, has_ionosphere: bool = True
) -> tuple[TroposphereModel, IonosphereModel]:
    """Return the tropospheric and ionospheric models of the corrections.

    Parameters
    ----------
    corrections : CorrectionsCard
    atmosphere : AtmosphereCard
        The true atmosphere, whose models replace `matched`.
    has_ionosphere : bool
        Whether the measurements contain an ionospheric delay; without it there is no correction either.
    """
    troposphere = corrections.troposphere
    ionosphere = corrections.ionosphere if has_ionosphere else NoIonosphere()
    return (
        atmosphere.troposphere if isinstance(troposphere, MatchedCorrection) else troposphere,
        atmosphere.ionosphere if isinstance(ionosphere, MatchedCorrection) else ionosphere,
    )
