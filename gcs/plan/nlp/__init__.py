"""The Gauss pseudospectral method: transcription, IPOPT, mesh refinement (Eqs. 36-50)."""
