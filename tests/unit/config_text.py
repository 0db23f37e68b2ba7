"""A cell file of the tests' own: the shipped one may be tuned without breaking them."""

CELL_TEXT = """\
name: emulated
devices:
  arm:         {address: emulated}
  gripper:     {address: emulated, transport: tcp, unit: 9}
  lights:      {address: emulated, transport: tcp, analog_unit: 1, relay_unit: 2}
  io:          {address: emulated, transport: tcp, unit: 1}
  overhead:    {address: emulated}
  inspection:  {address: emulated}
table:
  glowing_area: {x: [180, 540], y: [-225, 225]}
  drop_area:    {x: [270, 450], y: [-100, 100]}
cameras:
  overhead:
    size_px: [1280, 1024]
    focal_px: 3571.0
    centre_px: [639.5, 511.5]
    distortion: [-0.06, 0.04, 0.0004, -0.0003, 0.0]
    pose: {position: [360, 0, 1250], x_axis: [0, -1, 0], y_axis: [-1, 0, 0]}
    exposure_s: 0.010
    fps: 10
    formats: [GREY, YUYV]
  inspection:
    size_px: [1280, 1024]
    focal_px: 3733.0
    centre_px: [639.5, 511.5]
    distortion: [-0.05, 0.03, -0.0003, 0.0002, 0.0]
    pose: {position: [350, -700, 450], x_axis: [1, 0, 0], y_axis: [0, 0, -1]}
    exposure_s: 0.010
    fps: 10
    formats: [GREY, YUYV]
station:
  position: [350, 0, 450]
lamps:
  table_backlight: {analog: 0, relay: 0, kind: panel, centre: [360, 0, -1],
    normal: [0, 0, 1], up: [1, 0, 0], size: [450, 360]}
  table_ring:        {analog: 1, relay: 1, kind: ring,  centre: [360, 0, 1240], radius: 60}
  table_side:        {analog: 2, relay: 2, kind: spot,  centre: [760, 420, 620]}
  station_backlight: {analog: 3, relay: 3, kind: panel, centre: [350, 250, 450],
    normal: [0, -1, 0], up: [0, 0, 1], size: [350, 290]}
  station_ring:      {analog: 4, relay: 4, kind: ring,  centre: [350, -690, 450], radius: 60}
  station_side:      {analog: 5, relay: 5, kind: spot,  centre: [-120, -620, 820]}
arm:
  pose: {position: [0, 0, 0], x_axis: [1, 0, 0], y_axis: [0, 1, 0]}
  upper_mm: 253.5
  fore_mm: 253.5
  tool_mm: 177.0
  wrist_height_mm: 915.0
  jaw_max_mm: 85.0
  park_deg: {shoulder: 80, elbow: 0, yaw: 0, pitch: -90, roll: 0}
  links:
    column:   [-160, -67.5, -90, 90, 0, 1082]
    carriage: [-70, 50, -60, 60, 45, 125]
    upper:    [-45, 300, -45, 45, 45, 125]
    fore:     [-45, 285, -38, 38, -30, 40]
  arm_gripper:
    neck:     [-177, -138, -20, 20, -20, 20]
    palm:     [-140, -76, -52, 52, -22, 22]
  fingers:  {length_mm: 78, width_mm: 12, thickness_mm: 8, pad_length_mm: 24}
fixed_gripper:
  pose: {position: [150, -330, 430], x_axis: [0, 1, 0], y_axis: [0, 0, 1]}
  jaw_max_mm: 85.0
  body:
    palm:     [-163, -62, -70, 70, -38, 38]
  fingers:  {length_mm: 64, width_mm: 22, thickness_mm: 10, pad_length_mm: 30}
  post:     [100, 200, -560, -490, 0, 520]
obstacles:
  inspection_camera: [310, 390, -820, -690, 400, 500]
  station_panel:     [170, 530, 252, 275, 300, 600]
trays:
  accept:     {centre: [100, 390], size: [150, 150]}
  reject:     {centre: [-55, 400], size: [150, 150]}
  quarantine: {centre: [-205, 340], size: [140, 140]}
interlocks:
  emergency_stop: 0
  door: 1
  part_in_nest: 2
  part_in_fixed_gripper: 3
  supply: 4
  acknowledge: 5
"""
