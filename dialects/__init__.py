"""xDSL dialects: `rel` (relations), `mat` (per-instance small matrices), `kernel` (skeletons of generated code)."""
