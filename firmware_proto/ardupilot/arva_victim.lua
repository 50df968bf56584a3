--[[
 A virtual victim: the paper's receiver and one transmitter, computed on the autopilot, SCR_SDEV1_PROTO 28

 Sends binary frames (PROTOCOL.md of firmware_proto) to a scripting port of the same autopilot, where arva_receiver.lua
 or arva_search.lua reads them. Every frame is marked as synthetic. No noise. See arva_victim.md
--]]

---@diagnostic disable: param-type-mismatch

local PARAM_TABLE_KEY = 147
local PARAM_TABLE_PREFIX = "ARVV_"

local MAV_SEVERITY = {EMERGENCY=0, ALERT=1, CRITICAL=2, ERROR=3, WARNING=4, NOTICE=5, INFO=6, DEBUG=7}

local UPDATE_MS = 1000
local SCRIPTING = 28       -- of SERIALn_PROTOCOL
local KAPPA_EQ = 1.542
local INNER_M = 3.0
local MID_M = 50.0
local NEAREST_M = 0.01
local ID = 1
local SYNTHETIC = 1

-- half away from zero
local function rounded(x)
   return x < 0 and -math.floor(0.5 - x) or math.floor(x + 0.5)
end

local function dot(a, b)
   return a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
end

-- the rows of the rotation from NED to a body with these angles, rad
local function axes(roll, pitch, yaw)
   local cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
   local cy, sy = math.cos(yaw), math.sin(yaw)
   return {cp * cy, cp * sy, -sp},
      {sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp},
      {cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp}
end

--[[
   zone, d (cm), delta (degrees) of a receiver at a place from the transmitter, NED metres, with these angles, rad;
   equations 1 to 8 of the paper without noise. The transmitter's dipole has a yaw and a pitch, rad
--]]
local function reading(r, roll, pitch, yaw, dipole_yaw, dipole_pitch)
   local away = math.max(math.sqrt(dot(r, r)), NEAREST_M)
   local dipole = axes(0, dipole_pitch, dipole_yaw)
   local along = 3 * dot(dipole, r)
   local h = {}
   for k = 1, 3 do -- times 4 pi, and times the cube of the distance, so that small numbers stay numbers
      h[k] = (along / away * r[k] / away) - dipole[k]
   end
   local ax, ay, az = axes(roll, pitch, yaw)
   local x, y, z = dot(ax, h), dot(ay, h), dot(az, h)
   local flat = math.sqrt(x * x + y * y)
   local full = math.sqrt(flat * flat + z * z)
   local d = full > 0 and away * (KAPPA_EQ / full) ^ (1 / 3) or MID_M + 1
   if d <= INNER_M then
      return 2, rounded(100 * d), 0
   end
   d = flat > 0 and away * (KAPPA_EQ / flat) ^ (1 / 3) or MID_M + 1
   if d > MID_M then
      return 0, -1, -1
   end
   local delta = x == 0 and (y < 0 and -89 or 89) or rounded(math.deg(math.atan(y / x)))
   return 1, rounded(100 * d), math.max(-89, math.min(89, delta))
end

-- the binary frame of one channel, as a text
local function encode(sequence, zone, d, delta)
   local id = zone > 0 and ID or 255
   local body = {1, 9, sequence, SYNTHETIC, 1, id, zone, d & 0xFF, d >> 8 & 0xFF, delta & 0xFF, delta >> 8 & 0xFF}
   local register = 0xFFFF -- CRC-16/MCRF4XX
   for _, byte in ipairs(body) do
      local x = (register ~ byte) & 0xFF
      x = (x ~ x << 4) & 0xFF
      register = register >> 8 ~ x << 8 ~ x << 3 ~ x >> 4
   end
   local text = {string.char(0xA4, 0x57)}
   for _, byte in ipairs(body) do
      text[#text + 1] = string.char(byte)
   end
   return table.concat(text) .. string.char(register & 0xFF, register >> 8 & 0xFF)
end

if ... then -- required by another script
   return {reading = reading, encode = encode}
end

local function bind_param(name)
   local p = Parameter()
   assert(p:init(name), string.format('could not find %s parameter', name))
   return p
end

local function bind_add_param(name, idx, default_value)
   assert(param:add_param(PARAM_TABLE_KEY, idx, name, default_value), string.format('could not add param %s', name))
   return bind_param(PARAM_TABLE_PREFIX .. name)
end

assert(param:add_table(PARAM_TABLE_KEY, PARAM_TABLE_PREFIX, 5), 'could not add param table')

--[[
  // @Param: ARVV_NORTH
  // @DisplayName: Virtual victim north
  // @Description: Place of the virtual transmitter, north of home
  // @Units: m
  // @Range: -1000 1000
  // @User: Standard
--]]
local ARVV_NORTH = bind_add_param("NORTH", 1, 20)

--[[
  // @Param: ARVV_EAST
  // @DisplayName: Virtual victim east
  // @Description: Place of the virtual transmitter, east of home
  // @Units: m
  // @Range: -1000 1000
  // @User: Standard
--]]
local ARVV_EAST = bind_add_param("EAST", 2, 5)

--[[
  // @Param: ARVV_DOWN
  // @DisplayName: Virtual victim depth
  // @Description: Depth of the virtual transmitter below home
  // @Units: m
  // @Range: -100 100
  // @User: Standard
--]]
local ARVV_DOWN = bind_add_param("DOWN", 3, 0)

--[[
  // @Param: ARVV_YAW
  // @DisplayName: Virtual victim heading
  // @Description: Direction of the transmitter's long axis, from north to east
  // @Units: deg
  // @Range: -180 180
  // @User: Standard
--]]
local ARVV_YAW = bind_add_param("YAW", 4, 0)

--[[
  // @Param: ARVV_PITCH
  // @DisplayName: Virtual victim pitch
  // @Description: Tilt of the transmitter's long axis, up
  // @Units: deg
  // @Range: -90 90
  // @User: Standard
--]]
local ARVV_PITCH = bind_add_param("PITCH", 5, 0)

local function say(severity, ...)
   gcs:send_text(severity, "ARVV: " .. string.format(...))
end

local port = serial:find_simulated_device(SCRIPTING, 0)
if not port then
   say(MAV_SEVERITY.ERROR, "set SCR_SDEV_EN 1 and SCR_SDEV1_PROTO 28")
   return
end
say(MAV_SEVERITY.WARNING, "virtual victim: not a real receiver")

local function angle(name)
   return (ahrs["get_" .. name .. "_rad"] or ahrs["get_" .. name])(ahrs)
end

local sequence = 0

local function update()
   local zone, d, delta = 0, -1, -1
   local place = ahrs:get_relative_position_NED_home()
   if place then
      local r = {place:x() - ARVV_NORTH:get(), place:y() - ARVV_EAST:get(), place:z() - ARVV_DOWN:get()}
      local yaw, pitch = math.rad(ARVV_YAW:get()), math.rad(ARVV_PITCH:get())
      zone, d, delta = reading(r, angle("roll"), angle("pitch"), angle("yaw"), yaw, pitch)
   end
   port:writestring(encode(sequence, zone, d, delta))
   sequence = sequence + 1 & 0xFF
   return update, UPDATE_MS
end

return update()
