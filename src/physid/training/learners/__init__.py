"""The LightningModules: SysID, SupervisedID and SelfSupervisedID, with their phases and optimisation steps."""
