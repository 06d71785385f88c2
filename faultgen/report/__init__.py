"""Reports: self-contained HTML pages."""

from faultgen.report.dataset_report import write_report

__all__ = ["write_report"]
