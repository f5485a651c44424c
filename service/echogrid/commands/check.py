"""`echogrid check`: what a recording, or live buses, say is wrong with a configuration, how sure that is, and what mends it."""

from __future__ import annotations

import json
from pathlib import Path

from echogrid.commands.check_report import as_document, configured, render, said
from echogrid.commands.judged import check_live, check_log
from echogrid.commands.mended import check_new, write_mended
from echogrid.commands.terminal import progress
from echogrid.config.loading import load_config, remarks
from echogrid.config.tables import Config
from echogrid.errors import EchogridError
from echogrid.files import check_file, whole
from echogrid.pipeline import Pipeline
from echogrid.store.tile_keeper import check_ours
from echogrid.watching.metrics import check_installed
from echogrid.zenoh.credentials import checked
from echogrid.zenoh.publisher import check_pose_key


def command(
    config_path: Path,
    log: Path | None,
    *,
    seconds: float | None = None,
    as_json: bool = False,
    fix_out: Path | None = None,
    page: Path | None = None,
    force: bool = False,
) -> bool:
    """Prints what was found; returns whether nothing is wrong. `seconds`: so long the configured buses are listened to, instead of a log.

    Raises EchogridError where configuration, log or bus cannot be read, `page` or a file of `fix_out` is there already and not to be
    replaced by `force`, and, after all is printed, where the log is torn, its times are
    none, or a file that the configuration names would end the service at its start: a recording may be checked where that is not.
    """
    if log is not None and seconds is not None:
        raise EchogridError("either a LOG or --seconds can be checked, not both")
    config = load_config(config_path)
    readers = Pipeline(config, config_path).signals.readers
    try:
        check_pose_key(config.pose, config.vehicle, config.ros)
    except EchogridError as error:
        raise EchogridError(f"{config_path}: {error}") from error
    refused = _refused(config, config_path)
    if log is None and seconds is None:
        if fix_out is not None or page is not None:
            raise EchogridError("--fix-out and --report need a LOG or --seconds")
        if refused is not None:
            raise EchogridError(refused)
        if as_json:
            print(json.dumps(configured(config, config_path, len(readers)), indent=2))
            return True
        pose = config.pose
        beside = "" if pose is None else f", and a pose from {f'bus {pose.bus}' if pose.bus else f'key {pose.key}'},"
        radars = f"{len(config.radar)} radar{'s' * (len(config.radar) != 1)}"
        buses = "1 bus" if len(config.bus) == 1 else f"{len(config.bus)} buses"
        print(f"{config_path}: {radars} and ego motion{beside} on {buses}, {len(readers)} ids are read")
        for remark in remarks(config):
            print(remark)
        return True
    for option, written, suffix in (("--report", page, ".html"), ("--fix-out", fix_out, ".toml")):
        if written is not None:
            check_file(written, suffix)
            if not force:
                check_new(written, option)
    name = log.name if log is not None else "the live buses"
    with progress(f"check {name}") as advance:
        report = (
            check_log(config, config_path, log, advance) if log is not None else check_live(config, config_path, seconds or 0.0, advance)
        )
    shown = name if log is None else str(log)
    print(json.dumps(as_document(report, config_path, log), indent=2) if as_json else render(report, shown))
    if fix_out is not None:
        write_mended(report, config_path, fix_out, force=force)  # first: it may refuse, and then nothing is written
    if page is not None:
        from echogrid.judging.pages.page import page_of

        with whole(page) as partial:
            partial.write_text(page_of(report.recorded, report.judgement, said(report), f"{name} with {config_path.name}"))
    files = [str(path) for path in (page, fix_out) if path is not None]
    if files and not as_json:
        print(f"written: {', '.join(files)}")
    faults = [*([] if report.torn is None else [str(report.torn)]), *report.faults()]
    if faults and report.torn is None:
        faults[0] = f"{shown}: {faults[0]}"
    faults += [] if refused is None else [refused]
    if faults:
        raise EchogridError("; ".join(faults))
    return not report.findings


def _refused(config: Config, path: Path) -> str | None:
    """Why a service with this configuration would end at its start, by what is installed and in the files it names; None where it would
    not."""
    try:
        checked(config.publish)
        check_installed(config.metrics)
        if config.store.path is not None:
            check_ours(Path(config.store.path))
    except EchogridError as error:
        return f"{path}: {error}"
    return None
