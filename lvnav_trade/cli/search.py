"""Verbs that search designs by linear covariance: solve, indices, tune."""

from pathlib import Path
from typing import Annotated

import typer

from lvnav_trade.campaign.text import frame_table
from lvnav_trade.cli.console import CampaignFile, Jobs, Sets, VerbResult, folder_option, verb

Page = Annotated[Path | None, folder_option("the report and its tables", "results/NAME")]


@verb('my_campaign.yaml --vary "initial.heading=0.02 deg:5 deg" --log')
def solve(
    campaign: CampaignFile,
    sets: Sets = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="PATH=LEAST:LARGEST", help="field to search; given twice: a boundary"),
    ] = None,
    log: Annotated[bool, typer.Option("--log", help="search on a logarithmic scale")] = False,
    least: Annotated[
        str,
        typer.Option(
            "--least", metavar="TOTAL", help="instead: find the case with the least cost, mass, power or volume"
        ),
    ] = "",
    meet: Annotated[
        list[str] | None, typer.Option("--meet", metavar="REQUIREMENT", help="only these requirements [default: all]")
    ] = None,
    out: Page = None,
    jobs: Jobs = -1,
) -> VerbResult:
    """Find the largest sufficient value or the cheapest case.

    By linear covariance, with the filter re-tuned and frozen; runs on both sides of the answer confirm it. The
    varied field is that of the campaign (solve: ...) unless --vary states it.
    """
    from lvnav_trade import api

    solution = api.solve(campaign, sets or (), vary or (), log, meet or (), out, jobs, least)
    answers = solution.answers.drop(columns=["evaluations", "base_value"], errors="ignore")
    lines = [frame_table(answers)]
    if len(solution.confirmed):
        lines += ["", frame_table(solution.confirmed)]
    lines += [f"{solution.seconds:.0f} s", f"report: {solution.page}"]
    content = {
        "answers": solution.answers.to_dict("records"),
        "confirmed": solution.confirmed.to_dict("records"),
        "seconds": solution.seconds,
        "report": str(solution.page),
    }
    return VerbResult("\n".join(lines), content)


@verb("trade/sobol")
def indices(campaign: CampaignFile, sets: Sets = None, out: Page = None, jobs: Jobs = -1) -> VerbResult:
    """Compute global sensitivity to sigmas of error sources.

    The campaign's block `indices` has the settings. Frozen: in closed form. Re-tuned: by polynomials fitted to linear
    covariances.
    """
    from lvnav_trade import api

    result = api.indices(campaign, sets or (), out, jobs)
    lines = [frame_table(result.indices)]
    if result.remark:
        lines.append(f"linear covariance: {result.remark}")
    lines += [f"{result.samples} designs, {result.seconds:.0f} s", f"report: {result.page}"]
    content = {
        "case": result.case,
        "error": result.error,
        "predicted": result.predicted,
        "seconds": result.seconds,
        "remark": result.remark,
        "indices": result.indices.to_dict("records"),
        "report": str(result.page),
    }
    return VerbResult("\n".join(lines), content)


@verb("trade/tune")
def tune(campaign: CampaignFile, sets: Sets = None, out: Page = None, jobs: Jobs = -1) -> VerbResult:
    """Tune a filter over several cases; write its card.

    The campaign's block `tune` has the settings. The search is by linear covariance, and held-out cases
    validate the result.
    """
    from lvnav_trade import api

    result = api.tune(campaign, sets or (), out, jobs)
    lines = [
        frame_table(result.values),
        frame_table(result.cases),
        f"{result.evaluations} evaluations, {result.seconds:.0f} s",
        f"report: {result.page}",
        f"card: {result.file}",
    ]
    content = {
        "values": result.values.to_dict("records"),
        "cases": result.cases.to_dict("records"),
        "seconds": result.seconds,
        "report": str(result.page),
    }
    return VerbResult("\n".join(lines), content)
