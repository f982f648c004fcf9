"""Figures of a run of `run.sh`: what each tells, its target, the command behind it, and its value in the run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

SCENES = ("mid", "mid_16k", "hard", "hard_plus", "table_top", "kitchen", "clutter", "dinner", "drawer_pick")
TASKS = (
    *("TabletopReach-v0", "DrawerPick-v0", "ClutterPush-v0", "KitchenReset-v0"),
    *("TabletopLift-v0", "TabletopLiftAny-v0", "DrawerOpenPick-v0", "ClutterExtract-v0"),
)
ARMS = ("panda", "ur5e", "heron")
GPU_RATES = (
    *("mid:4096", "kitchen:4096", "clutter:4096", "dinner:4096", "drawer_pick:4096", "tabletop_lift:4096"),
    *("clutter_extract:4096", "benchmarks/ten_things.yaml:4096", "benchmarks/eight_slots.yaml:4096"),
    *("mid:16384", "mid_16k:16384", "hard:16384", "hard_plus:16384", "table_top:16384"),
    *("mid:65536", "mid_16k:65536", "mid:524288"),
)
_WATCHED = (
    "clutter clutter_extract clutter_push dinner drawer_open_pick drawer_pick hard hard_plus kitchen kitchen_reset mid"
)
_WATCHED += " mid_16k table_top tabletop_lift tabletop_lift_any tabletop_reach"
WATCHED = (
    *(f"{scene}:{worlds}" for scene in _WATCHED.split() for worlds in (1024, 4096, 16384, 65536)),
    *("mid:131072", "mid:524288"),
    *(f"{scene}:{worlds}" for scene in ("kitchen_any", "open_any") for worlds in (256, 1024, 4096)),
)
"""What `benchmarks.rates` compares with the best rates so far."""
CPU_RATES = (
    "mid:4096",
    "mid_16k:1024",
    "hard:1024",
    "hard_plus:1024",
    "table_top:1024",
    "kitchen:256",
    "clutter:256",
    "dinner:256",
)
"""Scenes and numbers of worlds; `run.sh` reads these lists, too."""


@dataclass(frozen=True)
class Run:
    """Lines of JSON of one run, by measurement.

    Attributes:
        measurements: the lines of each measurement
        name: name of the run's file, without its ending
    """

    measurements: Mapping[str, Sequence[Mapping[str, Any]]]
    name: str

    @property
    def about(self) -> Mapping[str, Any]:
        """Commit, date, versions and machine."""
        return self.measurements["about"][0]

    def line(self, measurement: str, **where: object) -> Mapping[str, Any]:
        """Return the last line of a measurement that has these values; see `_last`."""
        return _last(self.measurements[measurement], where)


def _last(lines: Sequence[Mapping[str, Any]], where: Mapping[str, object], has: str = "") -> Mapping[str, Any]:
    """Return the last line with these values, and with something under the key `has` if one is given.

    Raises:
        LookupError: there is none
    """
    return [line for line in lines if where.items() <= line.items() and (not has or line.get(has))][-1]


@dataclass(frozen=True)
class Figure:
    """A row of the page.

    Attributes:
        what: name of the figure
        command: command that measures it alone; `DEVICE` stands for the device
        value: its value in a run as text; raises LookupError for a run without it
        target: the value that is asked for, as text
    """

    what: str
    command: str
    value: Callable[[Run], str]
    target: str = ""


def sections() -> dict[str, list[Figure]]:
    """Return the figures of each section of the page."""
    return {
        "Layouts": [*_rates()],
        "Resets": [*_resets()],
        "Accuracy": [*_audits(), _relations()],
        "Reach": [*_reach()],
        "Other systems": [*_systems()],
        "Training libraries": [
            Figure(
                "bytes that `Sb3VecEnvWrapper` copies to the host for each world and step",
                "python -m benchmarks.sb3_bytes --env-id sceniris_gym/DrawerPick-v0 --steps 6 --episode 5",
                lambda run: f"{run.line('sb3_bytes')['bytes_per_world']:.0f}",
                "constant",
            )
        ],
    }


def _rates() -> Iterator[Figure]:
    targets = {"mid:4096": "0.4 ms", "mid:16384": "4,000,000/s", "mid:65536": "15,000,000/s"}
    targets |= {"mid_16k:65536": "4,000,000/s", "kitchen:4096": "1,500,000/s", "clutter:4096": "800,000/s"}
    for pair in dict.fromkeys((*GPU_RATES, *CPU_RATES)):
        scene, _, worlds = pair.partition(":")
        yield Figure(
            f"`{scene}`, {int(worlds):,} worlds: valid layouts/s; time for all; for 2% of the worlds",
            f"python -m benchmarks.generator_rates {pair} --device DEVICE",
            lambda run, at={"scene": scene, "num_envs": int(worlds)}: _rate(run.line("rates", **at)),
            targets.get(pair, ""),
        )
    yield Figure(
        "`hard_plus` relative to `mid`: valid layouts/s times placed objects, 16,384 worlds",
        "python -m benchmarks.generator_rates mid:16384 hard_plus:16384 --device DEVICE",
        _harder,
        "0.5",
    )


def _rate(line: Mapping[str, Any]) -> str:
    return f"{line['valid_per_s']:,}; {line['ms']:.3g} ms; {line['ms_of_2_percent']:.3g} ms"


def _harder(run: Run) -> str:
    hard, mid = (run.line("rates", scene=scene, num_envs=16384)["valid_per_s"] for scene in ("hard_plus", "mid"))
    return f"{5 * hard / (3 * mid):.2f}"


def _resets() -> Iterator[Figure]:
    for task in TASKS:
        yield Figure(
            f"`{task}`, 4,096 worlds: steps/s; relative to the same layouts from a bank; to one fixed layout",
            f"python -m benchmarks.reset_cost --task {task} --sources fresh replayed fixed --instances 2 --steps 25",
            lambda run, task=task: _steps(run.line(f"steps_{task}")),
            "; 0.99",
        )
    yield Figure(
        "resets of 2% of 4,096 worlds of `mid` with an arm in every step: cost of layouts made ahead; in place; from a "
        "bank",
        "python -m benchmarks.reset_step mid --arm",
        lambda run: "; ".join(
            f"{run.line('reset', way=way)['adds']['median']:.0f} us" for way in ("ahead", "in_place", "replayed")
        ),
        "80 us",
    )
    yield Figure(
        "second start of `TabletopReach-v0`, to its first step; to the end of the process",
        "python -m benchmarks.second_start TabletopReach-v0 --device DEVICE --repeats 3",
        lambda run: "; ".join(f"{run.line('start')[what]['median']:.1f} s" for what in ("first_step", "ended")),
        "5 s",
    )
    for task in TASKS:
        yield Figure(
            f"`{task}`: resets in contact with more than a support, or exploding; the same with uniform placement",
            "python -m benchmarks.honest_resets --layouts 20000",
            lambda run, task=task: "; ".join(
                "{either:,} of {layouts:,}".format(**run.line("contacts", task=task, placement=how))
                for how in ("fresh", "uniform")
            ),
            "0",
        )


def _steps(line: Mapping[str, Any]) -> str:
    return f"{line['steps_per_second']['fresh']:,}; {_ratio(line, 'replayed')}; {_ratio(line, 'fixed')}"


def _ratio(line: Mapping[str, Any], other: str) -> str:
    name = f"fresh / {other}"
    if "ratio_median" in line:  # a run with one environment of each source
        return f"{line['ratio_median'][name]:.3f}"
    return f"{line['ratio'][name]:.3f} ± {line['standard_error'][name]:.3f}"


def _systems() -> Iterator[Figure]:
    command = "python -m benchmarks.paper --peer uniform --peer scene_synthesizer --device DEVICE"
    for worlds in (1024, 16384, 524288):
        yield Figure(
            f"sceniris_gym, meshes of 16,384 faces, {worlds:,} scenes at once: valid scenes/s; from the start of a "
            "process with kernels kept",
            command,
            lambda run, worlds=worlds: "; ".join(
                (
                    f"{_system(run, 'Mid, warm', worlds=worlds)['valid_per_s']:,.0f}",
                    f"{_system(run, 'Mid, cold, kernel cache kept', worlds=worlds)['cold_s']:.1f} s",
                )
            ),
        )
    yield Figure(
        "sceniris_gym: valid scenes in which FCL finds a collision",
        command,
        lambda run: _colliding(_system(run, "Mid, valid ones that FCL finds in collision")),
        "0",
    )
    for processes, level in (("one process", "one process"), ("one process a core", "one a core")):
        yield Figure(
            f"Scene Synthesizer, the same scene, {processes}: valid scenes/s; those in which FCL finds a collision",
            command,
            lambda run, level=level: _peer(_system(run, "Scene Synthesizer, Mid", level=level)),
        )
    yield Figure(
        "the same candidates without checks: scenes/s; those in which FCL finds a collision",
        command,
        lambda run: _peer(_system(run, "Placement without checks, Mid")),
    )


def _system(run: Run, experiment: str, **where: object) -> Mapping[str, float]:
    """Return what the suite measured in an experiment; raise LookupError if nothing."""
    return _last(run.line("paper")["rows"], {"experiment": experiment, **where}, "measured")["measured"]


def _peer(measured: Mapping[str, float]) -> str:
    return f"{measured['valid_per_s']:,.3g}; {_colliding(measured)}"


def _colliding(measured: Mapping[str, float]) -> str:
    return f"{measured['colliding']:.1%} of {measured['judged']:.0f}"


def _audits() -> Iterator[Figure]:
    for scene in SCENES:
        yield Figure(
            f"`{scene}`: collisions missed; false alarms; objects out of place; deepest penetration in MuJoCo C",
            f"sceniris-gym audit {scene} -n 20000 --rejected 20000",
            lambda run, scene=scene: _audit(run.line(f"audit_{scene}")),
            "0; 0; 0; 0.1 mm",
        )
    yield Figure(
        "`mid`, `ratio_on_support: 1`: free objects that move more than 1 cm in 0.5 s; fastest",
        "sceniris-gym audit mid -n 20000 --rejected 0 --set objects.apple.ratio_on_support=1 "
        "--set objects.banana.ratio_on_support=1",
        lambda run: "{moved_share:.2%}; {top_speed_m_s:.3f} m/s".format(**run.line("audit_mid_on_support")),
        "0.5%; 1 m/s",
    )


def _audit(line: Mapping[str, Any]) -> str:
    wrong = line["misplaced"] + line["relation_violations"] + line["unreached"]
    return (
        f"{line['missed_collisions']} of {line['layouts']:,}; {line['false_alarms']} of {line['rejected']:,}; {wrong}; "
        f"{1e3 * line['deepest_penetration_m']:.1f} mm"
    )


def _relations() -> Figure:
    def value(run: Run) -> str:
        lines = run.measurements["relations"]
        worst = max(line["worst_m"] for line in lines if "worst_m" in line)
        return (
            f"{sum(line['broken'] for line in lines)} of {len(lines)} x {lines[0]['layouts']:,}; {1e3 * worst:.2f} mm"
        )

    command = "python -m tests.stress.relations --layouts 100000 --device DEVICE"
    return Figure("relations beyond 0.1 mm or 1 mrad, over all keywords; worst", command, value, "0")


def _reach() -> Iterator[Figure]:
    for arm in ARMS:
        for kind in "AB":
            for tier in ("map", "map_strict", "ik", "sampled"):
                yield Figure(
                    f"{arm}, set {kind}, `{tier}`: right; false positives",
                    f"python -m benchmarks.reach --arms {arm} --tiers {tier} --device DEVICE",
                    lambda run, at={"arm": arm, "set": kind, "tier": tier}: (
                        "{accuracy:.2%}; {false_positives:.3%}".format(**run.line("reach", **at))
                    ),
                )
        yield Figure(
            f"{arm}: lookups in its map; map in memory; file",
            f"python -m benchmarks.reach --arms {arm} --tiers map --device DEVICE",
            lambda run, arm=arm: _map(_last(run.measurements["reach"], {"arm": arm}, "lookups_per_s")),
            "1e9/s; 16 MB; 8 MB",
        )


def _map(line: Mapping[str, Any]) -> str:
    return f"{line['lookups_per_s']:.3g}/s; {line['map_bytes'] / 1e6:.1f} MB; {line['file_bytes'] / 1e6:.1f} MB"
