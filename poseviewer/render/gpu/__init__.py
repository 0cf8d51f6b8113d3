"""The loss on a GPU by wgpu: many poses in one submission, and no picture is read back."""
