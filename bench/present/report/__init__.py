"""Reports: a file each with a function that makes a `Page` of a result; `write_report` makes HTML of any page."""

from bench.present.report._atml import write_atml
from bench.present.report._batch import batch_page, batch_sentence
from bench.present.report._calibration import calibration_page
from bench.present.report._calibration_content import CalibrationContent
from bench.present.report._campaign import write_study
from bench.present.report._certificate import CertificateContent
from bench.present.report._certificate_of_runs import (
    CAMPAIGN_FILE,
    CERTIFICATE_FILE,
    certify,
    certify_campaign,
)
from bench.present.report._cycle import chamber_cycle_page
from bench.present.report._dcc import load_laboratory, write_dcc
from bench.present.report._file import write_pdf, write_report
from bench.present.report._gap import gap_page
from bench.present.report._gap_rehearsal import log_gaps_page
from bench.present.report._heading import heading_page, mixed_text
from bench.present.report._layout import render_page
from bench.present.report._look import look_page
from bench.present.report._page import Page
from bench.present.report._rlg import stepwise_page
from bench.present.report._rlg_expected import choice_sentence, expected_sentence
from bench.present.report._rlg_units import stepwise_units_page
from bench.present.report._run import report_run, run_page
from bench.present.report._run_content import run_content
from bench.present.report._scores import outside_sentence
from bench.present.report._standard import standard_test_page
from bench.present.report._whirl import whirl_page

__all__ = [
    "CAMPAIGN_FILE",
    "CERTIFICATE_FILE",
    "CalibrationContent",
    "CertificateContent",
    "Page",
    "batch_page",
    "batch_sentence",
    "calibration_page",
    "certify",
    "certify_campaign",
    "chamber_cycle_page",
    "choice_sentence",
    "expected_sentence",
    "gap_page",
    "heading_page",
    "load_laboratory",
    "log_gaps_page",
    "look_page",
    "mixed_text",
    "outside_sentence",
    "render_page",
    "report_run",
    "run_content",
    "run_page",
    "standard_test_page",
    "stepwise_page",
    "stepwise_units_page",
    "whirl_page",
    "write_atml",
    "write_dcc",
    "write_pdf",
    "write_report",
    "write_study",
]
