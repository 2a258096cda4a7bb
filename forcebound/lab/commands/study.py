"""Commands for studies that people take part in."""

import re
from pathlib import Path

import click

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import Group, command, run_to_signal, say, show
from forcebound.cli.lazy import when_used
from forcebound.cli.view import shown
from forcebound.errors import ConfigError
from forcebound.extras import check_installed
from forcebound.units import split_quantity

with when_used():
    import asyncio

    from forcebound.interface import live
    from forcebound.lab.study import data, markers, observers, order, page, report
    from forcebound.lab.study import graph as graphs
    from forcebound.lab.study import live as leading
    from forcebound.lab.study import plan as plans
    from forcebound.lab.study import session as sessions

SIMULATED = re.compile(r"simulated:([1-9][0-9]{0,2})")
_file = opt.argument(complete.files(".yaml", ".yml", shipped=lambda: plans.shipped()))

study = Group(
    "study", help="Run a user study: check its file, run it with a participant, analyse the data."
)


@command("new", study, short_help="Make a study file to change.")
def new(path: Path = opt.argument(type=opt.FILE)) -> None:
    r"""Make a study file to change: the paper's.

    \b
    forcebound study new my_study.yaml
    """
    path = path.with_suffix(".yaml")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write((plans.SHIPPED / plans.shipped()[0]).read_text(encoding="utf-8"))
    except FileExistsError:
        raise ConfigError(f"{path} exists: choose another name") from None
    show(f"study file: {path}; then: `forcebound study check {path}`")


@command("check", study)
def check(file: str = _file) -> None:
    r"""Check a study file, and say what a participant will meet.

    \b
    forcebound study check friction
    """
    plan = plans.load_study(file)
    trials = order.total(plan)
    show(f"{plan.name}: {plan.description}")
    show(f"question: {plan.question}")
    for counted, other in plan.pairs:
        show(f"pair: {counted} against {other}")
    if isinstance(method := plan.method, plans.Staircase):
        most = method.most + plan.training.repetitions
        most *= len(plan.blocks) * len(plan.conditions)
        low, _, step = plans.same_unit(method, method.start, method.step)
        unit = split_quantity(method.standard)[1]
        show(f"trials: at most {most} with training, two touches each")
        show(
            f"step: {method.step}, after {method.coarse} reversals half of it; no level is below"
            f" {low + step / 2.0:.6g} {unit}".rstrip()
        )
    else:
        show(f"trials: {trials} with training, two touches each")
    for number in range(2 * len(plan.blocks)):
        show(f"participant number {number}: {', '.join(order.blocks_of(plan, number))}")


@command("run", study, short_help="Run a study with one participant, or simulated ones.")
def run(
    file: str = _file,
    participant: str = opt.option(
        "Identifier, never a name; or simulated:N, so many simulated observers.",
        required=True,
        metavar="ID",
    ),
    folder: Path | None = opt.folder("Folder for the data. Default: name of the study."),
    seed: int = opt.number("Seed of the simulated observers.", default=1),
    weber: float = opt.number(
        "Their Weber fraction of stiffness, at 84 % right answers.",
        type=click.FloatRange(0.0, min_open=True),
        default=0.23,
    ),
    lapse: float = opt.number(
        "Share of their answers that are guesses.", type=click.FloatRange(0.0, 1.0), default=0.02
    ),
    records: bool = opt.flag("Record each simulated touch; slow.", "--record"),
    workers: int | None = opt.workers,
    port: int = opt.port("Port of the page. Default: any free."),
    opens: bool = opt.opens,
    lsl: str | None = opt.option(
        "Send markers to the Lab Streaming Layer; without a value, this machine alone finds them.",
        is_flag=False,
        flag_value="machine",
        type=click.Choice(["machine", "link", "site", "organization", "global"]),
    ),
) -> None:
    r"""Run a study; a participant who stopped goes on with the next trial.

    \b
    forcebound study run friction --participant simulated:10 --seed 1
    forcebound study run my_study.yaml --participant p07
    """
    plan = plans.load_study(file)
    folder = folder or Path(plan.name)
    simulated = SIMULATED.fullmatch(participant)
    if simulated is not None:
        observer = observers.Observer(seed, weber, lapse, records)
        observers.run_observers(observer, file, folder, int(simulated[1]), workers)
        show(f"data: {folder}; then: `forcebound study analyse {folder}`")
    elif participant.startswith("simulated"):
        raise ConfigError(f"expected simulated:N with N from 1 to 999, got {participant!r}")
    else:
        run_live_study(plan, participant, folder, port, opens, lsl)


async def _serve(
    session: "sessions.Session", server: "page.StudyServer", graph: "graphs.StudyGraph", opens: bool
) -> None:
    """Show a session on pages until it is finished, or stopped."""
    server.live = leading.LiveStudy(
        session,
        graph,
        lambda message: server.later(server.broadcast, message),
        lambda problem: say(f"forcebound: {problem}"),
    )
    running = asyncio.get_running_loop().run_in_executor(None, server.live.run)
    with shown(server.access, None, opens):
        show(f"participant:   {session.folder.name} ({session.kind})")
        try:
            await asyncio.wait([running])  # Ctrl-C cancels this, and not what it waits for
        finally:
            server.stop()
            await running


def run_live_study(
    plan: "plans.Study", participant: str, folder: Path, port: int, opens: bool, lsl: str | None
) -> None:
    """Run a study with a person on the live page, until it is finished, or stopped.

    ``lsl`` is the scope of markers for the Lab Streaming Layer; None: there are none.

    Raises:
        ConfigError: As :class:`Session`; if tornado or pylsl is missing, or a wall moves.
    """
    check_installed("the page", "tornado")
    graph = graphs.StudyGraph(plan, live.launch_unrecorded)
    kind: data.Kind = "person" if graph.movers == {"person"} else "rehearsal"
    marks = markers.Markers(graph.publish, None if lsl is None else markers.find_lsl(lsl))

    async def lead() -> None:
        server = page.StudyServer(port=port)  # first: a port that is taken uses up no number
        try:
            with sessions.Session(plan, folder, participant, kind, marks) as session:
                try:
                    if session.step.kind != "finished":
                        await _serve(session, server, graph, opens)
                finally:
                    done, every = session.progress
                    show(f"{done} of {every or '?'} trials answered; data: {session.folder}")
        finally:
            await server.close()

    run_to_signal(lead())


@command("analyse", study, short_help="Analyse the data of a study.")
def analyse(folder: Path = opt.argument(type=opt.FOLDER)) -> None:
    r"""Analyse the data of a study: report.md and report.png, in its folder.

    \b
    forcebound study analyse friction
    """
    check_installed("an analysis", "matplotlib", "scipy", "statsmodels")
    written = report.write_report(folder)
    show(written.read_text(encoding="utf-8"))
    show(f"report: {written}")
