"""xDSL dialects: `rel` (relations) and `mat` (per-instance small matrices), and the scalar graph below them."""
