"""Reports: one self-contained HTML file each, made from plain content; content, figures and layout apart."""

from bench.present.report._calibration import render_calibration
from bench.present.report._calibration_content import CalibrationContent, calibration_content, scheme_content
from bench.present.report._certificate import CertificateContent
from bench.present.report._certificate_of_runs import (
    CAMPAIGN_FILE,
    CERTIFICATE_FILE,
    certify,
    certify_campaign,
)
from bench.present.report._cycle import render_chamber_cycle
from bench.present.report._file import write_pdf, write_report
from bench.present.report._gap import GapContent, render_gap
from bench.present.report._gap_rehearsal import render_log_gaps
from bench.present.report._heading import HeadingContent, mixed_text, render_heading
from bench.present.report._rlg import render_rlg_study
from bench.present.report._run import render_run, report_run
from bench.present.report._run_content import run_content
from bench.present.report._standard import render_standard_test
from bench.present.report._study import write_study
from bench.present.report._whirl import render_whirl

__all__ = [
    "CAMPAIGN_FILE",
    "CERTIFICATE_FILE",
    "CalibrationContent",
    "CertificateContent",
    "GapContent",
    "HeadingContent",
    "calibration_content",
    "certify",
    "certify_campaign",
    "mixed_text",
    "render_calibration",
    "render_chamber_cycle",
    "render_gap",
    "render_heading",
    "render_log_gaps",
    "render_rlg_study",
    "render_run",
    "render_standard_test",
    "render_whirl",
    "report_run",
    "run_content",
    "scheme_content",
    "write_pdf",
    "write_report",
    "write_study",
]
