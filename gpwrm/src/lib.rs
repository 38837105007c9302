//! Deformation fields on scattered nodes (grid-point weighted residual method): displacement, gradient, shape functions, inverse, MLS surface
