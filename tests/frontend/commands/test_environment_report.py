"""The report for bug reports."""

import os
from importlib import metadata

import numpy as np

from yasps.frontend.commands import environment_report as module
from yasps.frontend.commands.environment_report import cpu_model, environment_report, package_version


def test_the_report_names_versions_and_folders(tmp_path, monkeypatch):
    monkeypatch.setenv("YASPS_CACHE", str(tmp_path / "cache"))
    report = environment_report()
    assert report["yasps"] == metadata.version("yasps")
    assert report["numpy"] == np.__version__
    assert report["cache folder"] == str(tmp_path / "cache")
    assert "sm_" in report["GPU"] or "NVIDIA" in report["GPU"] or "yasps[cuda]" in report["GPU"]
    assert list(report)[:3] == ["yasps", "Python", "operating system"]
    assert set(module.PACKAGES) <= set(report)
    assert f"of {os.cpu_count()}" in report["CPU"]
    assert all(isinstance(text, str) and text for text in report.values())


def test_a_missing_compiler_is_reported_not_raised(monkeypatch):
    def none_found():
        raise module.toolchain.CompilerNotFoundError("No C++ compiler: install g++")

    monkeypatch.setattr(module.toolchain, "find_compiler", none_found)
    assert environment_report()["C++ compiler"] == "No C++ compiler: install g++"


def test_an_unwritable_cache_is_reported_not_raised(monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("YASPS_CACHE", str(blocked / "cache"))
    report = environment_report()
    assert str(blocked) in report["cache folder"]


def test_a_missing_package_is_said_to_be_missing():
    assert package_version("no-such-distribution-of-yasps") == "not installed"


def test_cpu_model_is_read_from_cpuinfo(tmp_path):
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text("processor\t: 0\nmodel\t\t: 1\nmodel name\t: Abacus: 9000\nmodel name\t: Other\n")
    assert cpu_model(cpuinfo) == "Abacus: 9000"
    assert cpu_model(tmp_path / "none") != ""
