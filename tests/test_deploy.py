"""deploy/: its files name what exists, the steps refuse what they must, and a clean environment gets a server."""

import http.client
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fitting_core.fit.compiled.jit import FOLDER_VARIABLE
from fitting_core.io.people_file import PEOPLE_NAME
from tcfit_app.cli.main import parse
from tcfit_app.server.gate import Entry
from tcfit_app.server.serving import review_server

ROOT = Path(__file__).parents[1]
DEPLOY = ROOT / "deploy"
DOCKERFILE = (DEPLOY / "Dockerfile").read_text()
COMPOSE = (DEPLOY / "compose.yaml").read_text()


def run(*command: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | environment, timeout=60)


def test_the_dockerfile_copies_and_runs_what_there_is():
    copied = re.findall(r"^COPY (?!--from)(?:--\S+ )*(.+) \S+$", DOCKERFILE, re.MULTILINE)
    assert all((ROOT / name).exists() for names in copied for name in names.split())
    run = re.findall(r"/source/(\S+\.sh)", DOCKERFILE) + re.findall(r"/opt/tcfit/share/([\w.]+\.\w+)", DOCKERFILE)
    assert len(run) == 3 and all((ROOT / name).is_file() or (DEPLOY / name).is_file() for name in run)
    assert re.search(r"^RUN /source/deploy/install.sh /source /opt/tcfit$", DOCKERFILE, re.MULTILINE)
    assert f"{FOLDER_VARIABLE}=/opt/kernels" in DOCKERFILE and "\nUSER tcfit\n" in DOCKERFILE
    packages = re.findall(r"lib\w+1\b", DOCKERFILE)
    assert packages == ["libegl1", "libgl1"]


def test_compose_sets_what_serving_reads_and_publishes_only_the_proxy():
    read = set(re.findall(r"\$\{(TCFIT_\w+)", (DEPLOY / "serve.sh").read_text()))
    tcfit, caddy = COMPOSE.split("\n  caddy:\n")
    given = set(re.findall(r"^      (TCFIT_\w+):", tcfit, re.MULTILINE))
    assert given == {"TCFIT_PROJECT", "TCFIT_PUBLIC", "TCFIT_PASSWORD_FILE"} <= read
    assert "ports:" not in tcfit and "ports:" in caddy and "read_only: true" in tcfit
    assert "reverse_proxy tcfit:8080" in (DEPLOY / "Caddyfile").read_text()


def test_the_container_has_networks_and_writable_data_and_cache():
    _, build, image = DOCKERFILE.split("\nFROM ")
    assert "models add mediapipe --yes" in (DEPLOY / "install.sh").read_text()
    assert "XDG_DATA_HOME=/opt/networks" in build and "COPY --from=build /opt/networks /opt/networks" in image
    assert "TCFIT_NETWORKS=/opt/networks" in image
    mounted = set(re.findall(r"^      - \S+:(/\w+)", COMPOSE.split("\n  caddy:")[0], re.MULTILINE))
    for variable in ("XDG_DATA_HOME", "XDG_CACHE_HOME"):
        (folder,) = re.findall(rf"{variable}=(\S+)", image)
        assert folder in mounted and re.search(rf"--owner=tcfit .*{folder}\b", image)
    code = "import platformdirs as p; print(p.user_data_path('tcfit'), p.user_cache_path('tcfit'))"
    done = run(sys.executable, "-c", code, XDG_DATA_HOME="/data", XDG_CACHE_HOME="/cache")
    assert done.stdout.split() == ["/data/tcfit", "/cache/tcfit"]


@pytest.mark.parametrize("name", ["install.sh", "serve.sh"])
def test_the_steps_are_shell_and_can_be_run(name: str):
    assert os.access(DEPLOY / name, os.X_OK) and not run("sh", "-n", DEPLOY / name).stderr


def test_installing_refuses_what_is_no_checkout_and_what_is_there(tmp_path: Path):
    assert "usage:" in run(DEPLOY / "install.sh").stderr
    assert "is no checkout" in run(DEPLOY / "install.sh", tmp_path, tmp_path / "new").stderr
    assert "is there already" in run(DEPLOY / "install.sh", ROOT, tmp_path).stderr


@pytest.fixture
def served(tmp_path: Path):
    """Runs serve.sh with a tcfit that says what it was given."""
    program = tmp_path / "bin" / "tcfit"
    program.parent.mkdir()
    program.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    program.chmod(0o755)
    (tmp_path / "projects" / "a walk.tcfit").mkdir(parents=True)
    (tmp_path / "projects" / "a walk.tcfit" / "project.sqlite").touch()
    path = f"{program.parent}:{os.environ['PATH']}"

    def serve(**environment: str) -> subprocess.CompletedProcess[str]:
        return run(DEPLOY / "serve.sh", PATH=path, TCFIT_PROJECTS=str(tmp_path / "projects"), **environment)

    return serve


def test_serving_gives_tcfit_options_that_it_has(served):
    done = served(
        TCFIT_PROJECT="a walk.tcfit", TCFIT_PUBLIC="https://fits.example.org", TCFIT_PASSWORD_FILE="/run/secrets/p"
    )
    options = parse(done.stdout.splitlines())
    assert options.video.name == "a walk.tcfit" and options.server.files == options.video.parent
    assert (options.server.host, options.server.port, options.server.browser) == ("0.0.0.0", 8080, False)
    assert options.server.public == "https://fits.example.org" and options.server.password_file == Path(
        "/run/secrets/p"
    )
    assert parse(served(TCFIT_PROJECT="a walk.tcfit").stdout.splitlines()).server.password_file is None
    alone = served(TCFIT_PROJECT="a walk.tcfit", TCFIT_ADDRESS="127.0.0.1", TCFIT_PORT="9000")
    assert parse(alone.stdout.splitlines()).server.host == "127.0.0.1"


def test_serving_copies_the_networks_of_the_image_to_the_data(served, tmp_path: Path):
    network, data = tmp_path / "networks" / "tcfit" / "hand.onnx", tmp_path / "data"
    network.parent.mkdir(parents=True)
    network.write_text("new")
    (data / "tcfit").mkdir(parents=True)
    (data / "tcfit" / "hand.onnx").write_text("of an earlier image")
    done = served(TCFIT_PROJECT="a walk.tcfit", TCFIT_NETWORKS=str(tmp_path / "networks"), XDG_DATA_HOME=str(data))
    assert done.returncode == 0 and (data / "tcfit" / "hand.onnx").read_text() == "new"


def test_serving_takes_the_people_of_a_clip(served, tmp_path: Path):
    talk = tmp_path / "projects" / "talk.tcfit"
    talk.mkdir()
    (talk / PEOPLE_NAME).touch()
    assert parse(served(TCFIT_PROJECT="talk.tcfit").stdout.splitlines()).video == talk


def test_serving_says_what_is_missing(served):
    assert served(TCFIT_PROJECT="").returncode == 2 and "TCFIT_PROJECT is not set" in served(TCFIT_PROJECT="").stderr
    assert "There is no project at" in served(TCFIT_PROJECT="other.tcfit").stderr


def test_the_health_check_knows_a_server_that_asks_for_a_password():
    with review_server("A clip", port=0, open_browser=False, entry=Entry(password="x" * 12)) as server:
        port = str(server.address.port)
        assert run(sys.executable, DEPLOY / "healthy.py", TCFIT_PORT=port).returncode == 0
    assert run(sys.executable, DEPLOY / "healthy.py", TCFIT_PORT=port).returncode == 1


@pytest.mark.slow  # minutes, and a package index
def test_the_steps_make_a_server_in_a_clean_environment(tmp_path: Path):
    environment = {"HOME": str(tmp_path), "TCFIT_KERNELS": str(tmp_path / "kernels"), "PYTHONPATH": ""}
    index = {"TORCH_INDEX": os.environ.get("TORCH_INDEX", "")}
    installed = tmp_path / "env"
    command = [DEPLOY / "install.sh", ROOT, installed]
    done = subprocess.run(command, env=os.environ | environment | index, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Everything that tcfit fit needs works." in done.stdout
    environment |= {"PATH": f"{installed / 'bin'}:{os.environ['PATH']}", "TCFIT_PROJECTS": str(tmp_path)}
    make = "from fitting_core import demo_clip, read_clip; from tcfit_app.project.project import Project; "
    make += "from pathlib import Path; d = demo_clip(); "
    make += "Project.create(Path('demo.tcfit'), read_clip(d.video, d.keypoints), copy_media=True).close()"
    subprocess.run([installed / "bin" / "python", "-c", make], cwd=tmp_path, env=os.environ | environment, check=True)
    (tmp_path / "password").write_text("correct horse battery\n")
    serving = {"TCFIT_PROJECT": "demo.tcfit", "TCFIT_PASSWORD_FILE": str(tmp_path / "password"), "TCFIT_PORT": "8391"}
    with subprocess.Popen([DEPLOY / "serve.sh"], cwd=tmp_path, env=os.environ | environment | serving) as server:
        try:
            assert _status_at(8391) == 401
            assert run(sys.executable, DEPLOY / "healthy.py", TCFIT_PORT="8391").returncode == 0
        finally:
            server.terminate()


def _status_at(port: int) -> int:
    for _ in range(120):
        try:
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
            connection.request("GET", "/")
            return connection.getresponse().status
        except OSError:
            time.sleep(1)
    raise AssertionError("nothing answers")
