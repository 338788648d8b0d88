"""The block system [[F', B^T], [B, -C]] of bodies and contacts, assembled by dolfinx from UFL forms."""
