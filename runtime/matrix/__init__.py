"""The block-sparse symmetric matrix."""
