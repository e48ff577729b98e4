//! Links are what they were made of, and hostile ones do nothing.
