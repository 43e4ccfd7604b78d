"""The paper's claims in a report: files for docs/results.md and programs, and the page's table; and
the numbers of what its protocol can tell.
"""

from pathlib import Path

from dronecombat_jax.analysis.claims import paper_claims
from dronecombat_jax.analysis.claims_text import (
    COLUMNS,
    claims_json,
    claims_markdown,
    claims_notes,
    claims_rows,
)
from dronecombat_jax.analysis.panel import EVERY
from dronecombat_jax.analysis.protocol import Protocol, paper_protocol, protocol_json
from dronecombat_jax.analysis.study import Study
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.files.plain import to_json
from dronecombat_jax.report.page import NO_CLAIMS, Claims


def write_claims(study: Study, folder: Path, every: int = EVERY) -> tuple[Claims, list[Path]]:
    """Write claims.json and claims.md into `folder`; returns the page's table and the files.

    Nothing where the tournament has not both of the paper's methods. UserError 73.
    """
    claims = paper_claims(study.result, study.own_elo, every)
    if not claims:
        return NO_CLAIMS, []
    files = [folder / "claims.json", folder / "claims.md"]
    write_atomic(files[0], to_json(claims_json(claims)))
    write_atomic(files[1], claims_markdown(claims))
    return Claims(COLUMNS, claims_rows(claims), claims_notes(claims)), files


def write_protocol(study: Study, folder: Path, every: int = EVERY) -> Protocol | None:
    """Examine the paper's protocol and write paper_protocol.json into `folder`; None, and nothing
    written, where the tournament has not both methods. UserError 73.
    """
    protocol = paper_protocol(study.result, study.own_elo, every)
    if protocol is not None:
        write_atomic(folder / "paper_protocol.json", to_json(protocol_json(protocol)))
    return protocol
