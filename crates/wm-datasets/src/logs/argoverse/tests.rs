//! Tests of the Feather reader.
