"""Reports: self-contained HTML pages."""

from typing import TYPE_CHECKING

from faultgen.system.lazy import lazily

if TYPE_CHECKING:
    from faultgen.report.dataset_report import write_report

__all__ = ["write_report"]

# an answer needs no figure
lazily(__name__, {"write_report": "faultgen.report.dataset_report"})
