from typing import Any

Ar: Any
Gf: Any
Sdf: Any
Tf: Any
Usd: Any
UsdGeom: Any
UsdShade: Any
Vt: Any
