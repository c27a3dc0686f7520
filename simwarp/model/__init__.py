"""Model, constant during a run: builder, shapes, joints, couplings, parameters, topology."""
