"""Physics and appearance that resets draw: `DrawConfig`, and the keys for objects, lights, cameras and scenes."""

from math import inf
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import AfterValidator, BeforeValidator, Field, Strict, model_validator

from sceniris_gym.config.fields import Number, check_words, listed, wrong
from sceniris_gym.config.loader import DRAW_FORMS
from sceniris_gym.config.section import Section

End = Literal["least", "most"]
Ends = End | tuple[End, ...]
"""An end of a drawn range: one for all components of a field, or one for each component."""
DEVIATIONS = 3.0
"""Standard deviations at which normal distributions are cut off."""


class Word(NamedTuple):
    """A key of `randomize` in a scene file, such as `mass`.

    Attributes:
        field: The field of the model that a reset draws, such as body_mass.
        width: Number of drawn components in each row of the field.
        first: Index of the first drawn component.
        least, most: Bounds of all components, or a tuple with a bound for each component.
        follow: Fields that keep their ratio to the drawn field, as (field, first component, width).
        shared: If the scene gives a single number, it applies to this many components from `first` on, to all if None.
        form: The only form of draw that the key accepts, such as 'choice'. None if it accepts all forms.
        weak: The end of the range that is worse for holding a pose: heavier or more slippery objects, softer contacts,
            or weaker actuators.
        loose: The end of the range at which a joint resists least.
    """

    field: str
    width: int = 1
    first: int = 0
    least: float | tuple[float, ...] = -inf
    most: float | tuple[float, ...] = inf
    follow: tuple[tuple[str, int, int], ...] = ()
    shared: int | None = None
    form: str | None = None
    weak: Ends | None = None
    loose: Ends | None = None


WORDS = {
    "object": {
        "mass": Word("body_mass", least=1e-6, follow=(("body_inertia", 0, 3),), weak="most"),
        "ipos": Word("body_ipos", 3),
        "friction": Word("geom_friction", 3, least=0.0, shared=1, weak="least"),
        "solref": Word("geom_solref", 2, weak="most"),
        "solimp": Word(
            "geom_solimp",
            5,
            least=(0.0, 0.0, 0.0, 0.0, 1.0),
            most=(1.0, 1.0, inf, 1.0, inf),
            weak=("least", "least", "most", "most", "most"),
        ),
        "rgba": Word("geom_rgba", 4, least=0.0, most=1.0, shared=3),
        "damping": Word("dof_damping", least=0.0, loose="least"),
        "frictionloss": Word("dof_frictionloss", least=0.0, loose="least"),
        "armature": Word("dof_armature", least=0.0, loose="least"),
        "stiffness": Word("jnt_stiffness", least=0.0, loose="least"),
        "gains": Word("actuator_gainprm", least=1e-9, follow=(("actuator_biasprm", 1, 2),), weak="least"),
        "bias": Word("actuator_biasprm"),
        "forcerange": Word("actuator_forcerange", 2, weak=("most", "least")),
        "delay": Word("actuator_delay", least=0.0),
    },
    "light": {
        **{word: Word(f"light_{word}", 3) for word in ("pos", "dir")},
        **{word: Word(f"light_{word}", 3, least=0.0) for word in ("diffuse", "ambient", "specular")},
        **{word: Word(f"light_{word}", least=0.0, most=1.0, form="choice") for word in ("castshadow", "active")},
    },
    "camera": {
        "pos": Word("cam_pos", 3),
        "quat": Word("cam_quat", 3, least=-180.0, most=180.0, form="add"),
        "fovy": Word("cam_fovy", least=1.0, most=179.0),
    },
    "material": {
        "rgba": Word("mat_rgba", 4, least=0.0, most=1.0, shared=3),
        "texid": Word("mat_texid", first=1, least=0.0, form="choice"),
        **{word: Word(f"mat_{word}", least=0.0) for word in ("specular", "shininess", "emission")},
        "texrepeat": Word("mat_texrepeat", 2),
    },
    "scene": {"gravity": Word("gravity", 3, weak=("most", "most", "least")), "wind": Word("wind", 3)},
}
"""The words of objects and robots, of lights, cameras and materials, and of the whole scene."""


def _vector(value: Any) -> Any:
    value = listed(value)
    return value if isinstance(value, list | tuple) else (value,)


def _pair(value: Any) -> Any:
    value = listed(value)
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise wrong("should be [low, high], where low and high are numbers or lists of numbers")
    return value


_Vector = Annotated[tuple[Number, ...], BeforeValidator(_vector)]
_Ends = Annotated[tuple[_Vector, _Vector], BeforeValidator(_pair)]
_Chosen = Annotated[bool, Strict()] | Annotated[str, Strict()] | _Vector


class DrawConfig(Section):
    """The draw of a value by every reset. Give exactly one of `scale`, `add`, `abs` and `choice`.

    `scale` and `add` are relative to the value of the model, while `abs` and `choice` replace it. [low, high] are the
    ends of a `uniform` or `log_uniform` distribution. For a `normal` distribution, they are the mean and the standard
    deviation, and the distribution is cut off at three standard deviations. A single number applies to all components
    of a value, and a list has a number for each component. With `each`, every element (geom, joint, actuator) is drawn
    separately.
    """

    one_of = DRAW_FORMS
    scale: _Ends | None = None
    add: _Ends | None = None
    abs: _Ends | None = None
    choice: Annotated[tuple[_Chosen, ...], BeforeValidator(listed), Field(min_length=1)] | None = None
    distribution: Literal["uniform", "log_uniform", "normal"] = "uniform"
    each: Annotated[bool, Strict()] = False

    @property
    def form(self) -> str:
        """The key that is given: 'scale', 'add', 'abs' or 'choice'."""
        return self.given(DRAW_FORMS)[0]

    @property
    def ends(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """The two parameters of the distribution: its ends, or its mean and standard deviation. Empty for a choice."""
        return self.scale or self.add or self.abs or ((), ())

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        low, high = self.ends
        if len(low) != len(high):
            raise wrong("should have the same number of values in low and high")
        if self.choice is not None and self.distribution != "uniform":
            raise wrong("should have 'choice' or 'distribution', not both: a choice is always uniform")
        if self.distribution == "normal" and min(high, default=0.0) < 0.0:
            raise wrong("should be [mean, standard deviation] with a standard deviation of 0 or more")
        if self.distribution != "normal" and any(a > b for a, b in zip(low, high, strict=True)):
            raise wrong("should be [low, high] with low <= high")
        if self.distribution == "log_uniform" and min(low, default=1.0) <= 0.0:
            raise wrong("should have low and high above 0, because the distribution is log_uniform")
        return self


def _word(kind: str) -> AfterValidator:
    def check(name: str) -> str:
        check_words([name], WORDS[kind], f"should be one of {', '.join(WORDS[kind])}")
        return name

    return AfterValidator(check)


ObjectWord = Annotated[str, _word("object")]


class SceneDraws(Section):
    """The scene's `randomize`: draws for lights, cameras and materials by name or pattern, and for the whole model."""

    gravity: DrawConfig | None = None
    wind: DrawConfig | None = None
    lights: dict[str, dict[Annotated[str, _word("light")], DrawConfig]] = Field(default_factory=dict)
    cameras: dict[str, dict[Annotated[str, _word("camera")], DrawConfig]] = Field(default_factory=dict)
    materials: dict[str, dict[Annotated[str, _word("material")], DrawConfig]] = Field(default_factory=dict)
