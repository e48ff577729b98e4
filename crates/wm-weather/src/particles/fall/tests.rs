//! What falls, measured from the particles that are drawn.
