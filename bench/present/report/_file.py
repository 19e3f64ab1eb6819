"""Reports on disk: a page is there whole, or not at all; PDF by the browser that is on the machine."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from bench.present.report._layout import render_page
from bench.present.report._page import Page
from drivers.base.errors import ConfigurationError, RecordError
from drivers.base.files import replace_file

REPORT_FILE = "report.html"
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome", "chromium-headless-shell")
_PRINT_TIMEOUT_S = 120.0


def write_report(path: Path, page: Page) -> Path:
    """Write a page as one self-contained HTML file, in one piece, and return its path; raises RecordError.

    A page that is there already is removed first: a save that fails leaves no report rather than an old one,
    which may say "passed" of something else.
    """
    html = render_page(page)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        replace_file(path, html)
    except OSError as error:
        raise RecordError(
            "the report could not be saved: there is none",
            where=str(path),
            found=error.strerror or str(error),
            expected="a folder that can be written, with space on its disk",
            remedy="name another file with --out; the runs are not affected",
        ) from error
    return path


def find_browser() -> str:
    """Return the command of a Chromium or Chrome on this machine, empty if there is none."""
    return next((found for name in _BROWSERS if (found := shutil.which(name))), "")


def write_pdf(page: Path) -> Path:
    """Print a report to a PDF beside it and return its path; ConfigurationError without a browser.

    The browser prints the page's own print style: the PDF is the page, no second layout.
    """
    target = page.with_suffix(".pdf")
    target.unlink(missing_ok=True)
    browser = find_browser()
    if not browser:
        raise ConfigurationError(
            "a PDF is printed by Chromium or Chrome, and there is none",
            where=str(target),
            expected="one of " + ", ".join(_BROWSERS),
            remedy=f"`apt-get install chromium`, or print {page} from any browser",
        )
    with tempfile.TemporaryDirectory(prefix="gyrobench-pdf-") as profile:
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync"]
        command += ["--disable-background-networking", "--disable-component-update", "--disable-quic"]
        command += [f"--user-data-dir={profile}", "--no-pdf-header-footer", f"--print-to-pdf={target}"]
        try:
            done = subprocess.run(
                [*command, page.resolve().as_uri()],
                capture_output=True,
                timeout=_PRINT_TIMEOUT_S,
                check=False,
            )
            said = done.stderr.decode("utf-8", "replace")[-300:]
        except (OSError, subprocess.TimeoutExpired) as error:
            said = str(error)
    if not target.exists() or not target.read_bytes().startswith(b"%PDF-"):
        target.unlink(missing_ok=True)
        raise RecordError(
            "the browser printed no PDF",
            where=str(target),
            found=said.strip(),
            remedy=f"print {page} by hand",
        )
    return target
