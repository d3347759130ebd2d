"""The block-sparse symmetric matrix on a device."""
