"""Everything Lightning but the data: shared base, SysID, metrics, callbacks; what can be observed."""
