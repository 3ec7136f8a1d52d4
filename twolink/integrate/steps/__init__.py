"""Steps: methods, step control, compiled step maps, and worlds that advance by them."""
