"""`gyrobench panel` and `steer`: a session that another process runs, in a browser and from another shell."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, cast, get_args

from typer import Argument, Option, Typer

from bench.present.cli._options import DEFAULT_RUNS, Json
from drivers.base.errors import ConfigurationError

app = Typer()


@app.command()
def panel(
    runs: Annotated[Path, Argument(help="folder of runs and campaigns to watch")] = DEFAULT_RUNS,
    host: Annotated[str, Option(help="address to listen on; another than this machine needs a token")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, Option(help="port to listen on", min=1, max=65535)] = 8765,
    token: Annotated[
        str | None, Option(envvar="GYROBENCH_PANEL_TOKEN", help="what a browser must show", show_envvar=True)
    ] = None,
    bench: Annotated[
        list[Path] | None,
        Option(help="bench file (TOML): runs can be queued and started on it; repeat for several"),
    ] = None,
    campaigns: Annotated[
        Path | None, Option(help="folder of campaign files; default beside the bench file")
    ] = None,
    operators: Annotated[
        Path | None, Option(help="who may sign in: the file that `gyrobench operators add` makes")
    ] = None,
    certificate: Annotated[
        Path | None, Option(help="TLS certificate with its chain (PEM): serve https")
    ] = None,
    key: Annotated[
        Path | None, Option(help="the certificate's private key (PEM), if it is not in its file")
    ] = None,
    tls_elsewhere: Annotated[
        bool,
        Option("--tls-elsewhere", help="a proxy before the panel does TLS: passwords may come as they are"),
    ] = False,
) -> None:
    """Show the bench in a browser; plan and start runs there.

    A run is a process of its own: it goes on when the panel ends.
    """
    from bench.present.cli._console import Terminal

    try:
        from bench.present.panel import PanelSettings, serve
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            "the panel is not installed",
            found=str(error),
            expected="the extra `panel`",
            remedy="pip install 'gyrobench[panel]'",
        ) from error
    settings = PanelSettings(
        runs,
        host,
        port,
        token,
        tuple(bench or ()),
        campaigns,
        operators=operators,
        certificate=certificate,
        key=key,
        tls_elsewhere=tls_elsewhere,
    )
    settings.check()
    shown = f"[{host}]" if ":" in host else host
    query = "/?token=..." if token and operators is None else "/"
    scheme = "https" if certificate is not None else "http"
    Terminal().say(f"panel of {runs}: {scheme}://{shown}:{port}{query}   Ctrl-C ends it")
    serve(settings)


@app.command()
def steer(
    session: Annotated[Path, Argument(help="campaign folder, or run folder of a single run")],
    action: Annotated[str, Argument(help="pause, resume, abort or answer")],
    answer: Annotated[str, Argument(help="the answer to the question that is open")] = "",
    by: Annotated[str, Option(help="your name; default the user's")] = "",
    as_json: Json = False,
) -> None:
    """Answer, pause, resume or abort a run of another process.

    Exit code 1 if somebody else had answered first.
    """
    from bench.control.live import Action, drop_answer, drop_request, read_now
    from bench.control.questions import user_name
    from bench.present.cli._console import Terminal

    console = Terminal(as_json=as_json)
    by = by or f"{user_name()} at another shell"
    now = read_now(session)
    if now is None or not now["alive"]:
        raise ConfigurationError(
            "no session goes on here",
            where=str(session),
            found="no live state" if now is None else "a session that has ended",
            expected="the campaign folder, or the run folder of a single run, of a process that works",
        )
    if action in get_args(Action):
        drop_request(session, cast(Action, action), by)
        console.say(f"{action} asked for")
        console.say_json("result", action=action, by=by)
        return
    if action != "answer":
        raise ConfigurationError(
            "an unknown action", found=action, expected="answer, " + ", ".join(get_args(Action))
        )
    if not now["prompts"]:
        raise ConfigurationError("no question is open", where=str(session))
    prompt = now["prompts"][0]
    counts = drop_answer(session, int(prompt["id"]), answer, by)
    console.say(f"{prompt['question']}\n{counts.answer} ({counts.by})")
    counted = {"question": prompt["question"], "answer": counts.answer, "by": counts.by}
    console.say_json("result", action=action, **counted)
    sys.exit(0 if counts.by == by else 1)
