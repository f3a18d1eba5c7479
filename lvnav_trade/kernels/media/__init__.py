"""Air and plasma: standard atmosphere, refraction, tropospheric and ionospheric delay."""
