"""What may make an answer wrong and how far: one file a source of error, or a family; their imports register them."""

from . import air_loading, inputs, left_out, mesh, model, sampling, slab, steps  # noqa: F401
