from envs.tabletop_lift import TabletopLift as TabletopLift
