"""Every real case can be fitted: textured, coloured and plain models, small and large photos."""

from __future__ import annotations

import json

import numpy as np
import pytest

from poseviewer.evaluation.real_cases import main, run_trials, summary
from poseviewer.fit.pose_fit import Limits
from poseviewer.registration import FitSettings


def test_every_real_case_can_be_fitted(shared_data):
    settings = FitSettings(limits=Limits(evaluations=40))
    trials = list(run_trials(shared_data, settings, degrees=5, draws=1))
    cases = json.loads((shared_data / "cases.json").read_text())["cases"]
    assert [trial.case for trial in trials] == [case["id"] for case in cases]
    for trial in trials:
        assert np.isfinite([trial.error_percent_end, trial.loss_end]).all(), trial
        assert trial.loss_end <= trial.loss_start <= 3.0, trial
        assert trial.status == "EVALUATIONS_SPENT", trial
    assert summary(trials).count("\n") == len({case["set"] for case in cases})


BRIEFLY = Limits(evaluations=60)


@pytest.mark.parametrize(
    "settings",
    [FitSettings(grey=True, limits=BRIEFLY), FitSettings(pixels="clip", limits=BRIEFLY)],
)
def test_other_settings_run_as_well(shared_data, settings):
    trials = list(run_trials(shared_data, settings, 5, 1, "hope-0000-light0-mustard"))
    assert trials[0].loss_end < trials[0].loss_start


def test_a_folder_without_cases_is_said(tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main([str(tmp_path)])
    assert stop.value.code == 2
    assert "cases.json" in capsys.readouterr().err
