"""What the pages tell to type is typed: Kerf's own programs are run, and the commands of others are checked.

A command is an indented line, or a piece of code in a sentence that begins with a program's name. A page's commands
follow each other in a folder, as for somebody who reads it.
"""

import dataclasses
import functools
import importlib.util
import itertools
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
import yaml
from conftest import BLOCK, PROGRAM, REPOSITORY
from test_pages import blocks

import kerf

TUTORIAL = "docs/tutorial/README.md"
PATTERNS = ["README.md", "CONTRIBUTING.md", "client/*/README.md", "proto/*/README.md", "tests/*/README.md"]
PATTERNS += ["docs/README.md", "docs/*/README.md", "docs/*/*/README.md", "docs/how-to/*.md"]
PATTERNS += [f"docs/reference/{name}.md" for name in ["commands", "metrics", "scenes", "security", "server"]]

#: Programs that are run. `CHECKS` has those of others.
OWN = ["kerf-server", "kerf-load", "kerf-station"]

#: What a test has in place of what is the reader's, or would take long. Names in braces are attributes of `Reader`.
REPLACED = {
    # Addresses: a port that is free, and servers of the test.
    "0.0.0.0:50051": "0.0.0.0:0",
    "metrics_listen=127.0.0.1:9464": "metrics_listen=127.0.0.1:0",
    "https://host:50051": "{server}",
    "https://kerf.example.org:50051": "{server}",
    "https://kerf-0.kerf:50051": "{first}",
    "https://kerf-1.kerf:50051": "{second}",
    # A reader's system trusts these, and the variable KERF_TOKEN_FILE names the token.
    "https://kerf-0.kerf.example.org": "{first} {access}",
    "https://web-kerf-0.kerf.example.org": "{first} {access}",
    "https://a.example.org:50051": "{first} {access}",
    "https://kerf-1.kerf.example.org": "{second}",
    "https://b.example.org:50051": "{second}",
    # Files that the reader has, or has copied.
    "certificate.pem": "security/certificate.pem",
    "security.certificate_file=/etc/kerf/fullchain.pem": "security.certificate_file=security/certificate.pem",
    "security.key_file=/etc/kerf/privkey.pem": "security.key_file=security/key.pem",
    "certificates.pem": "{pair}/certificate.pem",
    "kerf-0.token": "{pair}/operator.token",
    "kerf-1.token": "{pair}/operator.token",
    "--config station.toml": "--config client/station/liver.toml",
    "--config my.toml": "--config client/station/liver.toml",
    "mine.toml": "block.toml",
    "security/tokens.toml --out prometheus.token": "tokens.toml --out prometheus.token",
    # Placeholders.
    "recordings/FILE.mcap": "{recording}",
    "replay FILE.mcap": "replay {recording}",
    "replay FILE": "replay {recording}",
    "check FILE": "check block.toml",
    "--file FILE": "--file tokens.toml",
    "move ID": "move {moved}",
    "ID FILE": "{session} state.kerf",
    "ID": "{session}",
    "--name N": "--name anna",
    "--role ROLE": "--role viewer",
    "--sessions N --stations K --viewers M": "--sessions 2 --stations 1 --viewers 1",
    "SECONDS": "0.1",
    "FACTOR": "2",
    "SCENE": "{scene}",
    "DIR": "out/any",
    # Less of what takes long: the tests' build takes seconds for the station's plots, and cannot step a liver in time.
    "kerf-load": "kerf-load --duration 0.1",
    "kerf-station run": "kerf-station run --duration 0.2",
    "--report out/run": "",
    "--scene liver": "--scene light",
    "kerf-server simulate": "kerf-server simulate --duration 0.02",
    "kerf-server tradeoff organ.toml": "kerf-server tradeoff {scene} --duration 0.02 --levels 1 --rates 60"
    " --voxel-scales 1 --tolerances 1e-2",
    "kerf-server top": "kerf-server top --interval 0.1",
}

#: Commands whose words are compared with what the program lists, no more.
NOT_RUN = [
    # It builds all eighteen scenes, which takes the tests' build seconds.
    "kerf-server scenes",
    # These ask Agones, for which `server/app/tests` has a stand-in.
    "kerf-server allocate https://agones-allocator.example.org --namespace kerf --certificate client.crt"
    " --key client.key --ca-file allocator-ca.crt",
    "kerf-server allocate URL",
    'kerf-station run --server "$(kerf-server allocate ...)"',
    # They take minutes, or seconds where another page has the like, which is run.
    "kerf-station experiment DIR",
    "kerf-station run --scene SCENE",
    "kerf-station trial --server 127.0.0.1:50051 --tissue soft --round-trip-ms 100",
    "kerf-server tradeoff SCENE --out DIR",
    # Sentences that leave out what a command is about.
    "kerf-load --viewers 50",
    "kerf-server allocate",
    "kerf-server check",
    "kerf-server session",
    "kerf-server session close",
    "kerf-server session download",
    "kerf-server session reset",
    "kerf-server simulate",
    "kerf-server simulate --script",
    "kerf-server tradeoff",
    "kerf-station doctor",
]

#: Whole words, the longest first.
REPLACEABLE = re.compile(
    rf"(?<!\S)({'|'.join(re.escape(text) for text in sorted(REPLACED, key=len, reverse=True))})(?!\S)"
)

#: What nothing is fenced as, so that no command is left out.
SHELLS = ["", "bash", "console", "sh", "shell"]

#: Where a page may have commands: fenced lines have none, an indented line goes on after a backslash, code has some.
PARTS = re.compile(
    r"^ *```(?P<language>\w*)\n(?P<fenced>.*?)^ *```$"
    r"|^ {4,}(?P<line>(?:[^\n]*\\\n)*[^\n]*)$"
    r"|`(?P<code>[^`]+)`",
    re.DOTALL | re.MULTILINE,
)


@dataclasses.dataclass
class Command:
    """What a page tells to type."""

    page: str
    line: int
    text: str
    #: It stands on a line of its own, and what it starts goes on.
    is_line: bool
    #: The lines that the page shows as its answer.
    printed: list[str] = dataclasses.field(default_factory=list)

    @property
    def words(self):
        """From the program's name on, after variables that are set for it."""
        words = shlex.split(self.text)
        return words[next(i for i, word in enumerate(words) if not re.match(r"\w+=", word)) :]

    @property
    def program(self):
        """Its name, wherever it lies."""
        return self.words[0] if self.words[0] == "e2e/run.sh" else Path(self.words[0]).name

    @property
    def is_run(self):
        return self.program in OWN and self.text not in NOT_RUN

    def __str__(self):
        return f"{self.page}:{self.line}: {self.text}"


def commands_of(page):
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    found, before = [], None
    for part in PARTS.finditer(text):
        line = text.count("\n", 0, part.start()) + 1
        if part["fenced"] is not None:
            assert part["language"] not in SHELLS, (
                f"{page}:{line}: indent commands, and name the language of anything else"
            )
            if part["language"] == "text" and before and not text[before.end() : part.start()].strip():
                found[-1].printed = part["fenced"].splitlines()
        elif part["line"] is not None:
            found.append(Command(page, line, _joined(part["line"].replace("\\\n", "")), is_line=True))
        elif re.match(rf"(\w+=\S+ )*(\S+/)?({'|'.join([*OWN, *CHECKS])})\s", part["code"]):
            said = Command(page, line, _joined(part["code"]), is_line=False)
            # A sentence that names a line of the page does not say to type it again.
            if said.text not in (command.text for command in found if command.is_line):
                found.append(said)
        before = part if part["line"] is not None else None
    return found


def _joined(text):
    """On one line, and without its remark."""
    return " ".join(re.split(r"\s#", text)[0].split())


class Server:
    """A server that a page tells to start, until `stop`."""

    _numbers = itertools.count()

    def __init__(self, words, folder, environment):
        self._log = folder / f"server-{next(self._numbers)}.log"
        with self._log.open("w") as log:
            self._process = subprocess.Popen(
                words, cwd=folder, env=environment, stdout=log, stderr=subprocess.STDOUT, text=True
            )
        port = self._said(r'"listening","address":"[^"]*:(\d+)"')[1]
        if words[1] == "replay":
            self._said("in a browser to watch")
        self.address = f"{'https://localhost' if '--security-dir' in words else 'http://127.0.0.1'}:{port}"

    def _said(self, pattern):
        """Waits until it has said that."""
        end_s = time.monotonic() + 60.0
        while not (found := re.search(pattern, self._log.read_text())):
            assert self._process.poll() is None, f"no {pattern}:\n{self._log.read_text()}"
            if time.monotonic() > end_s:
                self._process.kill()
            time.sleep(0.01)
        return found

    def stop(self):
        self._process.terminate()
        assert self._process.wait(10) == 0


class Reader:
    """Somebody who follows a page. What `REPLACED` names is made when a command asks for it."""

    scene = BLOCK

    def __init__(self, folder, request):
        self._folder = folder
        self._request = request
        #: Those that run; the page speaks of the last.
        self._servers = []
        self._tokens_are_read_s = 0.0
        self._environment = {
            **os.environ,
            "PATH": os.pathsep.join([str(folder / "target/release"), os.environ["PATH"]]),
            "KERF_LISTEN": "127.0.0.1:0",
            "KERF_LOG__FORMAT": "json",
            "KERF_SCENE_DIR": "scenes",
        }

    def __getitem__(self, name):
        return getattr(self, name)

    @property
    def server(self):
        """Address of the server that runs; without settings where the page has started none."""
        if not self._servers:
            self._servers.append(Server(["kerf-server", "serve"], self._folder, self._environment))
        return self._servers[-1].address

    @property
    def session(self):
        """A session of that server. A replay has one; no other can be made there."""
        with kerf.Client(self.server) as client:
            return next(iter(client.sessions()), None) or self._created(client)

    @property
    def recording(self):
        """The newest of those that the page has made, or one of a few steps."""
        recordings = self._folder / "recordings"
        if not list(recordings.glob("*.mcap")):
            settings = {"record_dir": recordings}
            with (
                kerf.LocalServer(PROGRAM, settings=settings) as server,
                server.client() as client,
                client.create_session(path=BLOCK) as session,
            ):
                # At least one state that is recorded to be seen: these are 200 ms.
                session.step(100)
        return max(recordings.iterdir(), key=lambda file: file.stat().st_mtime_ns)

    @property
    def pair(self):
        return self._request.getfixturevalue("pair").folder

    @property
    def first(self):
        return self._request.getfixturevalue("pair").first

    @property
    def second(self):
        return self._request.getfixturevalue("pair").second

    @property
    def access(self):
        return f"--ca-file {self.pair}/certificate.pem --token-file {self.pair}/operator.token"

    @property
    def moved(self):
        """A session of the first server of the pair."""
        token = (self.pair / "operator.token").read_text().strip()
        with kerf.Client(self.first, token=token, ca_file=self.pair / "certificate.pem") as client:
            return self._created(client)

    def _created(self, client):
        return client.create_session(path=BLOCK).id

    def follow(self, command):
        """Types a command of Kerf's, and compares what it prints with what the page shows."""
        left = REPLACEABLE.sub("", command.text).split()
        placeholders = [word for word in left if any(re.fullmatch(r"[A-Z]+(\.\w+)?", part) for part in word.split("/"))]
        assert not placeholders, f"{command}: `REPLACED` lacks {placeholders}"
        is_client = command.program != "kerf-server" or command.words[1] in ("session", "top")
        text = self._with_ids(command.text) if is_client else command.text
        words = shlex.split(REPLACEABLE.sub(lambda found: REPLACED[found[0]].format_map(self), text))
        if words[1] in ("serve", "replay") and not {"--print-config", "--verify"} & set(words):
            self._serve(words, command)
            return
        if is_client:
            self._environment["KERF_SERVER"] = self.server
        if "--token-file" in words:
            time.sleep(max(0.0, self._tokens_are_read_s - time.monotonic()))
        printed = self._ran(words, command)
        if words[1] == "token":
            # A server reads them again within a second.
            self._tokens_are_read_s = time.monotonic() + 1.1
        for line in command.printed:
            shown = self._with_ids(line)
            assert shown in printed.splitlines(), f"{command}: it does not print {shown!r}, but\n{printed}"

    def export(self, command):
        """Sets a variable as the shell does. Files that it names are there."""
        name = command.words[1].split("=")[0]
        for path in re.findall(r"\$PWD/([\w/-]+)", command.text):
            assert (self._folder / path).exists(), f"{command}: there is no {path}"
        self._environment[name] = self._ran(["sh", "-c", f'{command.text}; printf %s "${name}"'], command)

    def stop(self):
        while self._servers:
            self._servers.pop().stop()

    def _serve(self, words, command):
        """Starts a server in the place of the one before. One that a sentence names is stopped when it has answered."""
        if command.is_line:
            self.stop()
        self._servers.append(Server(words, self._folder, self._environment))
        access = ["--ca-file", "security/certificate.pem"] if self.server.startswith("https") else []
        self._ran(["kerf-server", "session", "health", "--server", self.server, *access], command)
        if not command.is_line:
            self._servers.pop().stop()

    def _with_ids(self, text):
        """With what the ids of this run's sessions begin with."""
        if not (shown := re.search(r"session-[0-9a-f]{8}-", text)):
            return text
        with kerf.Client(self.server) as client:
            ids = list(client.sessions())
        return text.replace(shown[0], ids[0].rstrip("0123456789")) if ids else text

    def _ran(self, words, command):
        ran = subprocess.run(
            words, check=False, cwd=self._folder, env=self._environment, capture_output=True, text=True, timeout=60
        )
        # A busy machine is not well, and the doctor ends by saying so.
        is_done = ran.returncode == 0 or ("doctor" in words and "\nBAD " in ran.stdout)
        assert is_done, f"{command}: {shlex.join(words)}\n{ran.stdout}{ran.stderr}"
        return ran.stdout + ran.stderr


def check_own(command):
    """It is a command of the program, with options that it has."""
    words = command.words[1:]
    asked = [command.program]
    while "Commands:" in help_of(*asked) and words:
        assert re.search(rf"^  {words[0]} ", help_of(*asked), re.MULTILINE), f"{command}: there is no {words[0]}"
        asked.append(words.pop(0))
    for option in (word.split("=")[0] for word in words if word.startswith("--")):
        assert re.search(rf"{option}(?![\w-])", help_of(*asked)), f"{command}: {' '.join(asked)} has no {option}"


@functools.cache
def help_of(program, *words):
    asked = [PROGRAM.with_name(program), *words, "--help"]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout


def check_make(command):
    """Its targets and variables are in the Makefile."""
    makefile = (REPOSITORY / "Makefile").read_text()
    for word in command.words[1:]:
        name, is_variable, _ = word.partition("=")
        known = rf"^{name} \?=" if is_variable else rf"^{name}:"
        assert re.search(known, makefile, re.MULTILINE), f"{command}: the Makefile has no {name}"


def check_cargo(command):
    """Packages, programs and benches exist. A test's name is that of a test or a module."""
    folder = REPOSITORY
    words = iter(command.words[1:])
    assert next(words) in ("bench", "build", "test"), f"{command}: not checked"
    for word in words:
        if word == "-p":
            folder = packages()[next(words)]
        elif word == "--bin":
            assert next(words) in programs(), f"{command}: there is no such program"
        elif word == "--bench":
            assert (folder / "benches" / f"{next(words)}.rs").exists(), f"{command}: there is no such bench"
        elif word.startswith("-"):
            assert word in ("--", "--release", "--nocapture", "--ignored"), f"{command}: {word} is not checked"
        else:
            name = word.removesuffix("::")
            assert re.search(rf"\b(fn|mod) \w*{name}", sources(folder)), f"{command}: {folder} has no test {name}"
    for variable in re.findall(r"(\w+)=", command.text):
        assert variable in sources(folder), f"{command}: nobody reads {variable}"


@functools.cache
def packages():
    """Folders of the workspace's packages, by name."""
    workspace = tomllib.loads((REPOSITORY / "Cargo.toml").read_text())["workspace"]
    folders = [REPOSITORY / member for member in workspace["members"]]
    return {tomllib.loads((folder / "Cargo.toml").read_text())["package"]["name"]: folder for folder in folders}


def programs():
    manifests = [tomllib.loads((folder / "Cargo.toml").read_text()) for folder in packages().values()]
    named = {program["name"] for manifest in manifests for program in manifest.get("bin", [])}
    return named | {name for name, folder in packages().items() if (folder / "src/main.rs").exists()}


@functools.cache
def sources(folder):
    return "".join(
        file.read_text(encoding="utf-8") for part in ("src", "tests") for file in (folder / part).rglob("*.rs")
    )


def check_docker(command):
    """The files are there, with the stage or the service that is named. What is pushed has been built before."""
    subject = command.words[1]
    if subject == "build":
        stages = re.findall(r" AS ([\w-]+)$", (REPOSITORY / option_of(command, "-f")).read_text(), re.MULTILINE)
        assert option_of(command, "--target") in stages, f"{command}: no such stage"
    elif subject == "compose":
        services = yaml.safe_load((REPOSITORY / option_of(command, "-f")).read_text())["services"]
        assert command.words[-1] in services, f"{command}: no such service"
    else:
        built = f"-t {command.words[2]} "
        assert subject == "push", f"{command}: not checked"
        assert built in (REPOSITORY / command.page).read_text(), f"{command}: not built before"


def check_kubectl(command):
    """Manifests are there, and set up what is named."""
    assert command.words[1] in ("apply", "create", "exec", "logs", "scale"), f"{command}: not checked"
    for option, name in (("-f", ""), ("-k", "kustomization.yaml")):
        if option in command.words:
            path = REPOSITORY / option_of(command, option) / name
            assert path.is_file(), f"{command}: there is no {path}"
    manifest = yaml.safe_load((REPOSITORY / "deploy/kubernetes/server/statefulset.yaml").read_text())
    sets = [option_of(command, "statefulset")] if "statefulset" in command.words else []
    for name in [*sets, *re.findall(r" ([\w-]+)-\d+ ", command.text)]:
        assert name == manifest["metadata"]["name"], f"{command}: there is no {name}"


def option_of(command, option):
    return command.words[command.words.index(option) + 1]


def check_pip(command):
    """The folder is a package, with the extras that are named."""
    assert command.words[1] == "install", f"{command}: not checked"
    folder, extras = re.fullmatch(r"([\w/]+)(?:\[(.*)\])?", command.words[2]).groups()
    manifest = tomllib.loads((REPOSITORY / folder / "pyproject.toml").read_text())
    known = manifest["project"]["optional-dependencies"]
    for extra in extras.split(",") if extras else []:
        assert extra in known, f"{command}: no extra {extra}"


def check_python(command):
    """It is a module of Python's, or what the page says to save; `test_pages` runs that."""
    if command.words[1] == "-m":
        assert importlib.util.find_spec(command.words[2]), f"{command}: no such module"
    else:
        saved = f"as `{command.words[1]}`"
        assert saved in (REPOSITORY / command.page).read_text(), f"{command}: the page does not say to save it"


def check_npm(command):
    """It is a script of the viewer's package, where it is none of npm's own."""
    scripts = json.loads((REPOSITORY / "client/web/package.json").read_text())["scripts"]
    name = option_of(command, "run") if "run" in command.words else command.words[1]
    assert name in [*scripts, "install"], f"{command}: no such script"


def check_viewer_tests(command):
    """There are such tests in the browser."""
    folder = REPOSITORY / "client/web/e2e"
    assert (folder / "run.sh").exists()
    assert list(folder.rglob(f"{command.words[1]}*.browser.ts")), f"{command}: no such tests"


def check_ray(command):
    """It is a command of Ray's, with options that it has, where Ray is installed."""
    if importlib.util.find_spec("ray"):
        known = importlib.import_module("ray.scripts.scripts").cli.commands[command.words[1]]
        options = {option for parameter in known.params for option in parameter.opts}
        for option in (word for word in command.words if word.startswith("--")):
            assert option in options, f"{command}: no option {option}"


def check_prometheus(command):
    """Its configuration is there."""
    assert (REPOSITORY / option_of(command, "--config.file")).exists(), f"{command}: no such file"


#: Programs that a test cannot run, because they build, install, need a network or another machine.
CHECKS = {
    "cargo": check_cargo,
    "docker": check_docker,
    "e2e/run.sh": check_viewer_tests,
    "kubectl": check_kubectl,
    "make": check_make,
    "npm": check_npm,
    "pip": check_pip,
    "prometheus": check_prometheus,
    "python": check_python,
    "python3": check_python,
    "ray": check_ray,
}

PAGES = sorted({str(page.relative_to(REPOSITORY)) for pattern in PATTERNS for page in REPOSITORY.glob(pattern)})


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A folder of the repository as it is once the programs are built, with what the tutorial has saved there."""
    folder = tmp_path_factory.mktemp("saved")
    scene, organ = blocks(TUTORIAL, "toml")
    (folder / "block.toml").write_text(scene)
    (folder / "organ.toml").write_text(organ)
    (folder / "slice.csv").write_text(blocks(TUTORIAL, "csv")[0])
    subprocess.run([sys.executable, "-c", blocks(TUTORIAL, "python")[0]], check=True, cwd=folder, timeout=60)
    scenes = folder / "scenes"
    scenes.mkdir()
    (scenes / "light.toml").write_text(BLOCK.read_text().replace('"left"', '"blade"'))
    built = folder / "target/release"
    built.mkdir(parents=True)
    for program in OWN:
        (built / program).symlink_to(PROGRAM.with_name(program))
    for part in ("client", "server"):
        (folder / part).symlink_to(REPOSITORY / part)
    return folder


@pytest.fixture
def reader(saved, tmp_path, request):
    shutil.copytree(saved, tmp_path, symlinks=True, dirs_exist_ok=True)
    reader = Reader(tmp_path, request)
    yield reader
    reader.stop()


@dataclasses.dataclass
class Pair:
    folder: Path
    first: str
    second: str


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Two servers with one certificate, and an operator's token of both."""
    folder = tmp_path_factory.mktemp("pair")
    token = ["token", "new", "--name", "anna", "--role", "operator", "--file", folder / "tokens.toml"]
    subprocess.run([PROGRAM, *token, "--out", folder / "operator.token"], check=True, timeout=60)
    settings = {"security.dir": folder}
    with kerf.LocalServer(PROGRAM, settings=settings) as first, kerf.LocalServer(PROGRAM, settings=settings) as second:
        yield Pair(folder, *(f"https://{server.address}" for server in (first, second)))


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_do_what_it_says(page, reader):
    for command in commands_of(page):
        if command.is_run:
            check_own(command)
            reader.follow(command)
        elif command.program in OWN:
            check_own(command)
        elif command.program == "export":
            reader.export(command)
        else:
            assert command.program in CHECKS, f"{command}: nobody tests {command.program}"
            CHECKS[command.program](command)


def test_no_entry_of_a_table_is_left_over():
    commands = [command for page in PAGES for command in commands_of(page)]
    replaced = {found for command in commands if command.is_run for found in REPLACEABLE.findall(command.text)}
    assert replaced == set(REPLACED)
    assert set(NOT_RUN) <= {command.text for command in commands}
    assert set(CHECKS) <= {command.program for command in commands}


def test_the_tutorials_wrong_modulus_is_a_problem(saved, tmp_path):
    (tmp_path / "block.toml").write_text(
        (saved / "block.toml").read_text().replace("_modulus_pa = 2e4", "_modulus_pa = 18")
    )
    asked = [PROGRAM, "check", "block.toml"]
    ran = subprocess.run(asked, check=False, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    (said,) = [line for text in blocks(TUTORIAL, "text") for line in text.splitlines() if line.startswith("problem:")]
    assert said in (ran.stdout + ran.stderr).splitlines()
