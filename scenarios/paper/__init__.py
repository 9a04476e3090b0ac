"""The paper's own tables and figures, made again with the truth at hand."""
