"""The command line: one JSON line on stdout, errors in words, files whole or not at all."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

import sceniris_gym
from sceniris_gym import cli
from sceniris_gym.errors import SceneKeyError


def answer(capfd: pytest.CaptureFixture, *arguments: str, device: str = "cpu") -> dict:
    """Run a command with --json, check that stdout is one line, and return what it says."""
    cli.main([*arguments, "--json", "--device", device])
    out = capfd.readouterr().out
    assert out.count("\n") == 1, out
    return json.loads(out)


def test_check_reports_rejections_per_object_and_cause(capfd: pytest.CaptureFixture):
    """In the Mid scene some bananas are rejected, all layouts are valid in the end."""
    found = answer(capfd, "check", "mid", "-n", "256")
    assert found["layouts"] == 256
    assert found["valid"] == 1.0
    assert 0.5 < found["first_pass_valid"] <= 1.0
    assert found["rejections"]["banana"]["collision"] > 0
    assert set(found["rejections"]) == {"cabinet", "apple", "banana"}


def test_overrides_change_the_scene(capfd: pytest.CaptureFixture):
    """A wider clearance is another scene, and is harder."""
    plain = answer(capfd, "check", "mid", "--layouts", "256")
    wider = answer(capfd, "check", "mid", "--layouts", "256", "--set", "objects.banana.clearance=0.03")
    assert wider["hash"] != plain["hash"]
    assert wider["rejections"]["banana"]["collision"] > plain["rejections"]["banana"]["collision"]


def test_an_override_must_be_a_pair():
    """`--set` without a value says how it is written."""
    with pytest.raises(SceneKeyError, match="KEY=VALUE"):
        cli.check("mid", changes=("objects.apple.clearance",))


def test_audit_of_the_mid_scene_finds_nothing(capfd: pytest.CaptureFixture):
    """No missed collision, no false alarm, nothing misplaced; nothing falls when footprints are supported."""
    found = answer(capfd, "audit", "mid", "--layouts", "300", "--rejected", "300", "--settled", "40")
    assert found["layouts"] == 300
    assert found["rejected"] == 300
    assert found["settled"] == 40
    for fault in ("missed_collisions", "false_alarms", "misplaced"):
        assert found[fault] == 0, found
    assert found["deepest_penetration_m"] <= 1e-4
    assert found["moved"].keys() == {"apple", "banana"}


def test_an_audit_can_be_made_here_and_judged_elsewhere(capfd: pytest.CaptureFixture, tmp_path: Path):
    """`--save` writes rows, `--load` judges them as if they were fresh."""
    words = ("audit", "mid", "--layouts", "20", "--rejected", "20")
    fresh = answer(capfd, *words)
    saved = answer(capfd, *words, "--save", str(tmp_path / "rows.npz"))
    assert (saved["layouts"], saved["rejected"], saved["hash"]) == (20, 20, fresh["hash"])
    assert answer(capfd, "audit", "mid", "--load", str(tmp_path / "rows.npz")) == fresh


def test_audit_of_fine_meshes_finds_nothing(capfd: pytest.CaptureFixture):
    """The same with triangle meshes of 16,000 faces."""
    found = answer(capfd, "audit", "mid_16k", "--layouts", "24", "--rejected", "24", "--settled", "0")
    assert found["geometry"] == "visual"
    for fault in ("missed_collisions", "false_alarms", "misplaced"):
        assert found[fault] == 0, found


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def test_bench_gives_every_figure(capfd: pytest.CaptureFixture, device: str):
    """All keys are there and belong together."""
    found = answer(capfd, "bench", "mid", "--num-envs", "64", device=device)
    assert found["valid_per_s"] == pytest.approx(found["valid"] * 64 / found["warm_s"])
    assert found["valid"] == 1.0
    assert found["fallbacks"] == 0
    assert (found["attempts"], found["restarts"], found["geometry"]) == (10, 8, "physics")
    assert found["faces"]["cabinet"] > 100
    for name in ("cold_s", "warm_s", "first_pass_valid", "full_reset_us", "partial_reset_us", "peak_bytes"):
        assert found[name] > 0, name


def test_bench_takes_the_other_geometry(capfd: pytest.CaptureFixture):
    """The visual meshes have more faces than the hulls."""
    found = answer(capfd, "bench", "mid", "--num-envs", "8", "--geometry", "visual")
    assert found["geometry"] == "visual"
    assert found["faces"]["apple"] >= 1000


def test_generated_rows_depend_on_their_seed_alone(capfd: pytest.CaptureFixture, tmp_path: Path):
    """Row i has seed S + i and episode 0, whatever N and the chunks are."""
    many = answer(capfd, "generate", "mid", "-n", "50", "--seed", "7", "-o", str(tmp_path / "many"))
    answer(capfd, "generate", "mid", "-n", "20", "--seed", "17", "--chunk", "8", "-o", str(tmp_path / "few"))
    a, b = (np.load(tmp_path / folder / "layouts-00000.npy") for folder in ("many", "few"))
    assert (many["layouts"], many["complete"]) == (50, True)
    assert set(a.dtype.names) == {
        *("qpos", "mocap_pos", "mocap_quat", "present", "valid", "first_pass_valid", "attempts", "status"),
        *("seed", "episode"),
    }
    assert a["seed"].tolist() == list(range(7, 57))
    assert not a["episode"].any()
    for name in ("qpos", "mocap_pos", "mocap_quat", "status", "attempts", "first_pass_valid", "valid", "present"):
        assert np.array_equal(a[name][10:30], b[name]), name
    assert a["qpos"].dtype == np.float32
    assert (a["mocap_pos"].shape, a["mocap_quat"].shape) == ((50, 1, 3), (50, 1, 4))
    assert a["present"].shape == (50, 3)
    assert a["present"].all()


def test_a_data_set_is_written_in_shares_resumed_and_verified(
    capfd: pytest.CaptureFixture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The environment names the share, or --shard does; what is wrong with the words is said."""
    command = ["generate", "mid", "-n", "5", "-o", str(tmp_path)]
    monkeypatch.setenv("RANK", "1")
    monkeypatch.setenv("WORLD_SIZE", "2")
    cli.main([*command, "--device", "cpu"])
    assert "1 of 1 parts are left for the other processes" in capfd.readouterr().out
    assert not answer(capfd, *command)["complete"]
    assert answer(capfd, *command, "--shard", "0/2")["complete"]
    monkeypatch.delenv("RANK")
    assert answer(capfd, *command, "--resume")["valid"] == 1.0
    assert answer(capfd, "generate", "-o", str(tmp_path), "--verify")["ok"]
    cli.main(["generate", "-o", str(tmp_path), "--verify"])
    assert "5 layouts of 'mid', all files are whole" in capfd.readouterr().out
    for words, message in (
        (command, "--resume"),
        ([*command, "--verify"], "Leave out SCENE"),
        (["generate", "mid", "-n", "5", "-o", str(tmp_path), "--format", "npz,csv"], "unknown format 'csv'"),
        (["generate", "-o", str(tmp_path / "nowhere"), "--verify"], "should be a complete data set"),
        (["generate", "mid", "-n", "5"], "-o FOLDER"),
        (["generate", "mid", "-o", "x"], "-n N"),
        ([*command, "--shard", "2/2"], "R/K"),
    ):
        with pytest.raises(SystemExit) as stop:
            cli.main(words)
        assert stop.value.code == 2
        assert message in capfd.readouterr().err


def test_the_scene_opens_in_stock_mujoco(capfd: pytest.CaptureFixture, tmp_path: Path):
    """scene.zip alone, in a process without this package: bodies have the scene's names, and rows can be stepped."""
    answer(capfd, "generate", "mid", "-n", "3", "-o", str(tmp_path))
    program = """
import json, sys, mujoco, numpy as np
with open(sys.argv[1] + "/scene.zip", "rb") as file:
    model = mujoco.MjSpec.from_zip(file).compile()
rows = np.load(sys.argv[1] + "/layouts-00000.npy")
data = mujoco.MjData(model)
data.qpos, data.mocap_pos, data.mocap_quat = rows["qpos"][2], rows["mocap_pos"][2], rows["mocap_quat"][2]
mujoco.mj_forward(model, data)
assert not (data.contact.dist < 0).any()
with open(sys.argv[1] + "/dataset.json") as file:
    names = json.load(file)["object_names"]
for name in (*names, "cabinet/upper_drawer"):
    model.body(name)
assert "sceniris_gym" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=True, cwd=tmp_path)


def test_a_stopped_run_leaves_no_half_written_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Ctrl-C while the layouts are written: what is there is whole, and says that it is not all."""

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    kept = os.fsync
    monkeypatch.setattr(os, "fsync", lambda file: (monkeypatch.setattr(os, "fsync", interrupted), kept(file)))
    with pytest.raises(KeyboardInterrupt):
        cli.generate("mid", layouts=4, out=tmp_path, device="cpu")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".progress", "scene.zip"]


@pytest.mark.parametrize(("stop", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stopped_command_leaves_no_temporary_file(tmp_path: Path, stop: int, status: int):
    """Ctrl-C and SIGTERM in the middle of writing: the status of shells, an empty folder."""
    program = f"""
import os, signal, sys, time
from sceniris_gym.__main__ import main
os.fsync = lambda _: (os.kill(os.getpid(), {int(stop)}), time.sleep(60))
sys.argv = ["sceniris-gym", "generate", "mid", "-n", "2", "--device", "cpu", "-o", sys.argv[1]]
main()
"""
    command = [sys.executable, "-c", program, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == status
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == [".progress"]


@pytest.mark.parametrize(
    "command",
    [["generate", "mid", "-n", "1"], ["replay", "0123456789abcdef:train:0:0"], ["demo"], ["reach", "panda", "--build"]],
)
def test_a_path_that_cannot_be_written_is_refused_before_the_work(
    capfd: pytest.CaptureFixture, tmp_path: Path, command: list[str]
):
    """A file where a folder should be, and a folder where the file should be; nothing is left behind."""
    (tmp_path / "file").write_text("kept")
    (tmp_path / "folder" / "scene.zip").mkdir(parents=True)
    for out in (tmp_path / "file" / "inside", tmp_path / "folder"):
        with pytest.raises(SystemExit) as stop:
            cli.main([*command, "--out", str(out), "--device", "cpu"])
        out, err = capfd.readouterr()
        assert (stop.value.code, out) == (2, "")
        assert "cannot be written" in err
        assert "Traceback" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]
    assert [path.name for path in (tmp_path / "folder").iterdir()] == ["scene.zip"]


def test_a_new_folder_is_only_made_when_there_is_something_to_write(tmp_path: Path):
    """A scene that does not exist leaves no empty folders, though those could be made."""
    with pytest.raises(SystemExit):
        cli.main(["generate", "nowhere", "-n", "1", "-o", str(tmp_path / "a" / "b"), "--device", "cpu"])
    assert list(tmp_path.iterdir()) == []


def test_the_version_is_told(capfd: pytest.CaptureFixture):
    """In one line, without a command."""
    cli.main(["--version"])
    assert capfd.readouterr().out == f"sceniris-gym {sceniris_gym.__version__}\n"


def test_replay_makes_a_layout_again_from_its_id(capfd: pytest.CaptureFixture, tmp_path: Path):
    """The poses are those of the data set's row, and a picture is written."""
    made = answer(capfd, "generate", "mid", "-n", "4", "--seed", "40", "-o", str(tmp_path))
    said = answer(capfd, "replay", f"{made['hash']}:train:42:0", "--out", str(tmp_path / "one.png"))
    (found,) = said["layouts"]
    qpos = np.load(tmp_path / "layouts-00000.npy")["qpos"][2]
    with (tmp_path / "scene.zip").open("rb") as file:
        model = mujoco.MjSpec.from_zip(file).compile()
    adr = model.jnt_qposadr[model.joint("banana/free").id]
    assert found["objects"]["banana"]["pos"] == pytest.approx(qpos[adr : adr + 3])
    assert found["objects"]["cabinet"]["joints"]["upper"] == pytest.approx(
        qpos[model.jnt_qposadr[model.joint("cabinet/upper").id]]
    )
    assert found["status"] == "valid"
    assert Image.open(tmp_path / "one.png").size[0] > 900


def test_check_and_generate_tell_an_id_to_replay(capfd: pytest.CaptureFixture, tmp_path: Path):
    """Their text has one id, of the first layout, which replay takes."""
    for command in (["check", "mid", "--layouts", "4"], ["generate", "mid", "-n", "4", "-o", str(tmp_path / "set")]):
        cli.main([*command, "--seed", "40", "--device", "cpu"])
        (named,) = {*re.findall(r"[0-9a-f]{16}:train:40:0", capfd.readouterr().out)}
        assert answer(capfd, "replay", named, "--out", str(tmp_path / "one.png"))["layouts"][0]["scene"] == "mid"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["check", "nowhere"], "nowhere"),
        (["check", "mid", "--set", "objects.apple.clearence=0.1"], "clearance"),
        (["check", "mid", "--set", "objects.aple.clearance=0.1"], "Did you mean 'apple'?"),
        (["replay"], "the layout id is missing"),
        (["replay", "not-an-id"], "scenehash:split:seed:episode"),
        (["replay", "0123456789abcdef:train:0:0"], "(mid)"),
        (["generate", "mid", "-n", "0", "-o", "x"], "at least 1"),
        (["generate", "mid", "-n", "1", "-o", "x", "--seed", "-1"], "--seed -1"),
    ],
)
def test_errors_are_words_on_stderr(capfd: pytest.CaptureFixture, arguments: list[str], words: str):
    """A wrong argument ends with status 2 and one message, nothing on stdout, no traceback."""
    with pytest.raises(SystemExit) as stop:
        cli.main([*arguments, "--device", "cpu"])
    out, err = capfd.readouterr()
    assert stop.value.code == 2
    assert out == ""
    assert words in err
    assert "Traceback" not in err


def test_libraries_cannot_print_into_the_answer():
    """In a process of its own, in which Warp starts up, stdout is still one JSON line, after at most two others."""
    command = [sys.executable, "-m", "sceniris_gym", "check", "mid", "--layouts", "4", "--json", "--device", "cpu"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert json.loads(done.stdout)["layouts"] == 4
    assert len(done.stderr.splitlines()) <= 2, done.stderr


IMPOSSIBLE = {"floor": {"size": [0.1, 0.1]}, "bank": 8, "objects": {}}


def test_a_bad_verdict_ends_with_status_1(capfd: pytest.CaptureFixture, tmp_path: Path):
    """A scene without room: the verdict and the table of rejections on stdout, also as JSON, no message on stderr."""
    cans = {name: {"asset": "can", "on": "floor"} for name in ("a", "b", "c", "d", "e", "f")}
    (tmp_path / "full.yaml").write_text(json.dumps(IMPOSSIBLE | {"objects": cans}))
    for more in ([], ["--json"]):
        with pytest.raises(SystemExit) as stop:
            cli.main(["check", str(tmp_path / "full.yaml"), "--device", "cpu", *more])
        said = capfd.readouterr()
        assert (stop.value.code, "error:" in said.err) == (1, False)
        if more:
            assert json.loads(said.out)["ok"] is False
        else:
            assert said.out.startswith("FAIL: ")
            assert "rejected " in said.out


def test_a_damaged_data_set_ends_with_status_1(capfd: pytest.CaptureFixture, tmp_path: Path):
    """With the name of the file, in a verdict."""
    answer(capfd, "generate", "mid", "-n", "2", "-o", str(tmp_path))
    with (tmp_path / "layouts-00000.npy").open("r+b") as file:
        file.seek(-1, os.SEEK_END)
        file.write(b"\xff")
    with pytest.raises(SystemExit) as stop:
        cli.main(["generate", "-o", str(tmp_path), "--verify"])
    assert stop.value.code == 1
    assert re.match("FAIL: .*layouts-00000.npy", capfd.readouterr().out)


@pytest.mark.parametrize("command", [["audit", "mid", "--worlds", "8"], ["check", "mid", "-n", "few"]])
def test_a_usage_error_names_the_help_of_its_command(capfd: pytest.CaptureFixture, command: list[str]):
    """And has status 2."""
    with pytest.raises(SystemExit) as stop:
        cli.main(command)
    assert stop.value.code == 2
    assert f"sceniris-gym {command[0]} --help" in capfd.readouterr().err
