"""The explorer's page served on this machine: answers while a design is dragged, the full plate on request.

A second process computes the designs of the cloud.
"""

from __future__ import annotations

import asyncio
import json
import pickle
import secrets
import socket
import tempfile
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

from aiohttp import ClientPayloadError, web
from aiohttp.http_exceptions import BadHttpMessage

from geometry.errors import GeometryError, MeshError
from pipeline.errors import InputError
from pipeline.explore.answer import BATCH, Document, Explorer, Scene, compute, read_design
from pipeline.logs import TerminalLog
from pipeline.workers import LocalWorkers, WorkerLost
from solvers.errors import SolverError
from solvers.machine import workers

SHOWN = 12  # lines of the log, the last ones
Solve = Callable[[Scene, dict[str, float], Any], Document]

HOST = "127.0.0.1"
PAGE = Path(__file__).with_name("page")
MAX_BYTES = 4096  # of a request: a design takes two hundred

FILES = {
    "": ("index.html", "text/html"),
    "explore.js": ("explore.js", "text/javascript"),
    "figures.js": ("figures.js", "text/javascript"),
    "explore.css": ("explore.css", "text/css"),
}

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}  # fmt: skip

REFUSED = (InputError, SolverError, MeshError, GeometryError)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class FileLog(TerminalLog):
    """A log whose lines another process reads from a file."""

    verbose = True

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path

    def warning(self, id: str, text: str) -> None:
        """Write a line like any other."""
        self._say(f"warning {id}: {text}")

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Write that a step begins."""
        self._say(f"{name} ...")
        yield

    def _say(self, text: str) -> None:
        with self.path.open("a", encoding="utf-8") as file:
            file.write(" ".join(text.split()) + "\n")


class FullPlate:
    """One assembled plate at a time; `solve` must be picklable, as `compute` is."""

    def __init__(self, scene: Scene, solve: Solve = compute) -> None:
        self.scene, self.solve = scene, solve
        self._workers: LocalWorkers | None = None
        self._solved: Future[Document] | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._lines: list[str] = []

    @property
    def running(self) -> bool:
        """Whether a plate is being solved."""
        return self._solved is not None and not self._solved.done()

    def start(self, design: dict[str, float]) -> None:
        """Begin to solve a design."""
        self._clear()
        self._folder = tempfile.TemporaryDirectory(prefix="antinode-explore-")
        self._workers = self._workers or LocalWorkers(1, workers())
        self._solved = self._workers.submit(_solved, self.solve, self.scene, design, self._file)

    def report(self) -> Document | None:
        """Whether a plate is being solved, the last lines of its log and its result; None where none was asked for."""
        solved = self._solved
        if solved is None:
            return None
        running = not solved.done()
        lines = self._read() if self._folder else self._lines
        return {"running": running, "lines": lines[-SHOWN:], "result": None if running else _result(solved)}

    def stop(self) -> None:
        """End a process that is at work; what it was at has no result."""
        if self._workers:
            self._workers.kill()
            self._workers = None
        self._clear()

    def _clear(self) -> None:
        if self._folder:
            self._lines = self._read()
            self._folder.cleanup()
            self._folder = None

    def _read(self) -> list[str]:
        file = self._file
        return file.read_text(encoding="utf-8").splitlines() if file.exists() else []

    @property
    def _file(self) -> Path:
        assert self._folder is not None
        return Path(self._folder.name) / "log"


class BackgroundExplorer:
    """The same explorer in a process of its own, started when it is first asked."""

    def __init__(self, explorer: Explorer) -> None:
        self.explorer = explorer
        self._workers: LocalWorkers | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def cloud(self, first: int, count: int) -> list[Document]:
        """As `Explorer.cloud`; by this process where the other one is lost."""
        if self._workers is None or self._folder is None:
            self._workers, self._folder = LocalWorkers(1, 1), tempfile.TemporaryDirectory(prefix="antinode-explore-")
            self._file.write_bytes(pickle.dumps(Explorer(self.explorer.scene, self.explorer.model)))
        try:
            designs: list[Document] = self._workers.submit(_cloud, self._file, first, count).result()
        except (WorkerLost, CancelledError):
            return Explorer(self.explorer.scene, self.explorer.model).cloud(first, count)  # the page's own is at work
        return designs

    def close(self) -> None:
        """End the process and delete its file."""
        if self._workers and self._folder:
            self._workers.kill()
            self._folder.cleanup()

    @property
    def _file(self) -> Path:
        assert self._folder is not None
        return Path(self._folder.name) / "explorer.pickle"


class Server:
    """Answers of one explorer under one token. Designs are solved one at a time, full plates in a process of their own, one at
    a time too, and every other part of the cloud in another process.
    """

    def __init__(self, explorer: Explorer, token: str | None = None) -> None:
        self.explorer = explorer
        self.token = token or secrets.token_urlsafe(16)
        self.port = 0
        self._live = ThreadPoolExecutor(1, "live")
        self.full = FullPlate(explorer.scene)
        self._beside, self._asks_beside = BackgroundExplorer(explorer), ThreadPoolExecutor(1, "cloud")

    def application(self) -> web.Application:
        """The routes, all under the token."""
        app = web.Application(middlewares=[self._guard], client_max_size=MAX_BYTES)
        base = f"/{self.token}"
        app.router.add_get(f"{base}/{{name:(explore\\.js|figures\\.js|explore\\.css)?}}", self._file)
        app.router.add_get(f"{base}/scene", self._scene)
        app.router.add_post(f"{base}/answer", self._answer)
        app.router.add_post(f"{base}/cloud", self._cloud)
        app.router.add_post(f"{base}/case", self._case)
        app.router.add_post(f"{base}/full", self._start)
        app.router.add_get(f"{base}/full", self._report)
        app.router.add_post(f"{base}/full/stop", self._stop)
        return app

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.port}/{self.token}/"

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse another host's name and another page's request; one line for every fault."""
        own = {f"{HOST}:{self.port}", f"localhost:{self.port}"}
        origin = request.headers.get("Origin")
        if request.headers.get("Host") not in own or (
            origin is not None and origin not in {f"http://{h}" for h in own}
        ):
            response: web.StreamResponse = refusal("this page answers its own machine's browser only", 403)
        else:
            response = await _or_one_line(request, handler)
        response.headers.update(HEADERS)
        return response

    async def _file(self, request: web.Request) -> web.StreamResponse:
        name, kind = FILES[request.match_info["name"]]
        return web.Response(text=(PAGE / name).read_text(encoding="utf-8"), content_type=kind)

    async def _scene(self, request: web.Request) -> web.StreamResponse:
        return web.json_response(self.explorer.scene.document())

    async def _answer(self, request: web.Request) -> web.StreamResponse:
        design = read_design(await _json(request), self.explorer.scene.limits)
        document = await asyncio.get_running_loop().run_in_executor(self._live, self.explorer.answer, design)
        return web.json_response(document, dumps=_dumps)

    async def _cloud(self, request: web.Request) -> web.StreamResponse:
        given = await _json(request)
        first = given.get("first") if isinstance(given, dict) else None
        if not isinstance(first, int) or isinstance(first, bool) or first < 0:
            raise InputError("a question for the cloud must contain the number of its first design")
        loop = asyncio.get_running_loop()
        if first // BATCH % 2:
            document = await loop.run_in_executor(self._asks_beside, self._beside.cloud, first, BATCH)
        else:
            document = await loop.run_in_executor(self._live, self.explorer.cloud, first, BATCH)
        return web.json_response(document, dumps=_dumps)

    def close(self) -> None:
        """End both processes."""
        self.full.stop()
        self._beside.close()

    async def _case(self, request: web.Request) -> web.StreamResponse:
        return web.Response(
            text=self.explorer.scene.toml(read_design(await _json(request), self.explorer.scene.limits))
        )

    async def _start(self, request: web.Request) -> web.StreamResponse:
        given = await _json(request)
        design = read_design(given, self.explorer.scene.limits)
        if self.full.running:
            return refusal("a full plate is being solved already: wait for it, or stop it", 409)
        self.full.start(design)
        return web.json_response({"started": True})

    async def _stop(self, request: web.Request) -> web.StreamResponse:
        stopped = self.full.running
        if stopped:
            await asyncio.get_running_loop().run_in_executor(None, self.full.stop)
        return web.json_response({"stopped": stopped})

    async def _report(self, request: web.Request) -> web.StreamResponse:
        report = self.full.report()
        if report is None:
            return refusal("no full plate has been asked for", 404)
        return web.json_response(report, dumps=_dumps)


def refusal(text: str, status: int) -> web.Response:
    """One line of why not."""
    return web.json_response({"error": text}, status=status)


def listening(port: int = 0) -> socket.socket:
    """A socket on the loopback address alone, on a free port unless one is named."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((HOST, port))
    except OSError as fault:
        sock.close()
        raise InputError(f"--port {port}: {fault.strerror or fault}") from fault
    return sock


def serve(server: Server, port: int, ready: Callable[[str], None]) -> None:
    """Serve until interrupted; call `ready` with the address once the page can be opened."""
    sock = listening(port)
    server.port = sock.getsockname()[1]

    async def run() -> None:
        # a client that leaves cancels its handler, and with it a question that still waits for its turn
        runner = web.AppRunner(server.application(), access_log=None, shutdown_timeout=1.0, handler_cancellation=True)
        await runner.setup()
        try:
            await web.SockSite(runner, sock).start()
            ready(server.address)
            await asyncio.Event().wait()
        finally:
            await runner.cleanup()

    try:
        asyncio.run(run())
    finally:
        server.close()


def _result(solved: Future[Document]) -> Document:
    """What a plate's process gave, or one line of why it gave nothing."""
    try:
        return solved.result()
    except (WorkerLost, CancelledError) as fault:
        return {"why_not": str(fault) or "stopped"}
    except Exception as fault:  # no one reads a worker's traceback
        return {"why_not": f"{type(fault).__name__}: {' '.join(str(fault).split())}"}


def _solved(solve: Solve, scene: Scene, design: dict[str, float], file: Path) -> Document:
    try:
        return solve(scene, design, FileLog(file))
    except (*REFUSED, MemoryError) as fault:
        return {"why_not": " ".join(str(fault).split())}


def _cloud(file: Path, first: int, count: int) -> list[Document]:
    return _explorer(file).cloud(first, count)


@lru_cache(maxsize=1)
def _explorer(file: Path) -> Explorer:
    explorer: Explorer = pickle.loads(file.read_bytes())  # written by the process that started this one
    return explorer


async def _or_one_line(request: web.Request, handler: Handler) -> web.StreamResponse:
    try:
        return await handler(request)
    except REFUSED as fault:
        lines = fault.lines if isinstance(fault, InputError) else [str(fault)]
        return refusal("; ".join(" ".join(line.split()) for line in lines), 400)
    except web.HTTPRequestEntityTooLarge:
        return refusal(f"a request holds at most {MAX_BYTES} bytes", 413)
    except web.HTTPException as fault:
        return refusal(f"nothing here: {fault.reason}", fault.status)
    except Exception as fault:  # one line with the headers of every answer, instead of aiohttp's own page
        return refusal(f"unexpected {type(fault).__name__}: {' '.join(str(fault).split())}", 500)


async def _json(request: web.Request) -> Any:
    """A request's body as JSON, which is UTF-8 whatever charset is named. InputError for any other."""
    try:
        return json.loads(await request.read())
    except web.HTTPRequestEntityTooLarge:
        raise
    except (ValueError, RecursionError, BadHttpMessage, ClientPayloadError, web.RequestPayloadError) as fault:
        raise InputError("a request must be a design as JSON") from fault


def _dumps(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False)
