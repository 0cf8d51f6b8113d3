"""True poses as a table of jobs."""

from pathlib import Path

import numpy as np

from poseviewer.batch.job_table import load_jobs
from poseviewer.evaluation.cases import load_cases
from poseviewer.files.pose import load_pose
from poseviewer.scene.settings import FitSettings
from tests.evaluation.real_folder import write_real_folder
from tests.measure import truths
from tests.scene import Scene


def test_jobs_start_from_the_true_poses(scene: Scene, tmp_path: Path) -> None:
    folder = write_real_folder(scene)
    assert truths.main([str(folder), str(tmp_path)]) == 0
    jobs, cases = load_jobs(tmp_path / "jobs.csv", FitSettings()), load_cases(folder)
    assert len(jobs) == len(cases)
    for job, case in zip(jobs, cases, strict=True):
        assert job.path(job.photo).samefile(case.photo)
        assert job.path(job.model).samefile(case.mesh)
        pose, truth = load_pose(job.path(job.start)).pose, case.truth
        assert np.array_equal(
            pose.camera_from_model.translation, truth.camera_from_model.translation
        )
        assert pose.camera == truth.camera
