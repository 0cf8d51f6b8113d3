"""All edits under one name, as tests call them."""

from poseviewer.app.state.edits import *  # noqa: F403  # noqa: F403  # noqa: F403
from poseviewer.app.state.pointer_edits import *  # noqa: F403
from poseviewer.app.state.pose_edits import *  # noqa: F403  # noqa: F403
from poseviewer.app.state.search_edits import *  # noqa: F403  # noqa: F403
