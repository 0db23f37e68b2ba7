"""`cellctl verify`: the rows and files of a run that have changed."""

from pathlib import Path

from controller.results.run import prove_run

from ..terminal.output import emit, print_line


def verify_run(runs_dir: Path, run: str | None, head: str | None, *, as_json: bool) -> int:
    """Check pictures, results and journal of a run.

    Parameters
    ----------
    runs_dir : folder of all runs
    run : id, the beginning of an id, or folder of the run; None for the newest
    head : hash of a row, noted when the run was done; None if none was
    as_json : print JSON lines instead of sentences

    Returns
    -------
    exit code: 0 where all is as it was written, else 1
    """
    proof = prove_run(runs_dir, run, head)
    for one in proof.tampered:
        if as_json:
            emit({"event": "tampered", "subject": one.subject, "problem": one.problem})
        else:
            print_line(f"{one.subject}: {one.problem}", style="bold red")
    if as_json:
        emit(
            {
                "event": "verified",
                "run": proof.run_id,
                "untampered": not proof.tampered,
                "rows": proof.row_count,
                "files": proof.file_count,
                "last_row": proof.last_seq,
                "last_hash": proof.last_hash,
            }
        )
    elif proof.tampered:
        print_line(f"{proof.run_id}: TAMPERED WITH, or damaged", style="bold red")
    else:
        print_line(
            f"{proof.run_id}: as it was written: {proof.row_count} rows, {proof.file_count} files",
            style="green",
        )
        print_line(
            f"Note the hash of row {proof.last_seq} elsewhere; with --head it proves later that "
            f"nothing up to it was written anew: {proof.last_hash}"
        )
    return 1 if proof.tampered else 0
