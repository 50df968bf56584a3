--[[
 Search for an ARVA transmitter (an avalanche transceiver, 457 kHz) inside the autopilot

 In GUIDED, when a parameter or a switch asks for it, follows the field lines with the readings of arva_receiver.lua,
 which has to lie beside this file, crosses the place where it is strongest, and stops there. See arva_search.md
--]]

---@diagnostic disable: param-type-mismatch
---@diagnostic disable: need-check-nil

local PARAM_TABLE_KEY = 146
local PARAM_TABLE_PREFIX = "ARVS_"

local MAV_SEVERITY = {EMERGENCY=0, ALERT=1, CRITICAL=2, ERROR=3, WARNING=4, NOTICE=5, INFO=6, DEBUG=7}

local MODE_GUIDED = 4
local MODE_LOITER = 5
local ROTATION_PITCH_270 = 25 -- downwards
local RANGEFINDER_GOOD = 4
local INNER = 2               -- zone
local NO_ID = 255

local UPDATE_MS = 10          -- of the driver
local SEARCH_MS = 100
local SILENT_MS = 2000        -- hover after this time without a frame
local DEAF_MS = 60000         -- end after this time without a signal
local NO_POSITION_MS = 2000
local REPEATS_MS = 3000      -- end after this time without a new sequence number
local SAME_M = 4             -- end after this distance with the same reading
local UNFIT = 8 | 32         -- bits of the status: self-test fault, not searching
local NO_RANGE_MS = 2000     -- end after this time without the rangefinder, if it has measured
local SURE = 0.3              -- share of the least d: the error of 95 of 100 places found is smaller
local NEARER = 0.7            -- share of the distance at which another transmitter is chosen instead
local STICK = 0.15            -- share of full travel: the pilot has moved a stick
local STICK_MIDDLE = 0.2      -- of the throttle, where LOITER holds the height
local SWITCH_HIGH = 2

--[[
   the strategy: places are metres north and east, angles radians from north, d is in metres, nil without a signal
--]]

local Cross
do -- a block, because ArduPilot allows 100 local variables a script
   local LOW = 1.3               -- d is low below this multiple of the least d
   local REACH = 0.7             -- reach of an arm past that, in multiples of the least d
   local SHORTEST_M = 1.5        -- shortest reach
   local TOGETHER_MS = 400       -- average readings within this time
   local MOST_READINGS = 400     -- of an arm
   local AT_M = 0.5              -- a goal is reached within this distance
   local SETTLED_M = 0.5         -- a middle that moved less has settled
   local MOST_ARMS = 8

   --[[
      the rescuers' cross. An arm begins at the centre and goes both ways until d is low no more, and a reach
      beyond. Its middle is the next centre, and the next arm goes across. course: of the first one
   --]]
   function Cross(centre_n, centre_e, course)
      local self = {settled = false}
      local arms = 0
      local on_arm, sense                    -- sense: 1 or -1, direction along the arm
      local along, power                     -- readings in order: place on the arm; power of the field, d^-6
      local most, newest                     -- power; index of the last reading
      local sum_along, sum_power, count      -- of the readings to average
      local last_ms                          -- time of the last average
      local complete                         -- the arm has been flown

      local function begin(n, e)
         centre_n, centre_e, on_arm, sense = n, e, false, 1
         along, power, most, newest = {}, {}, 0, 1
         sum_along, sum_power, count = 0, 0, 0
         last_ms, complete = nil, false
      end

      local function keep(place, here)
         while newest > 1 and along[newest - 1] > place do
            newest = newest - 1
         end
         while along[newest] and along[newest] <= place do
            newest = newest + 1
         end
         table.insert(along, newest, place)
         table.insert(power, newest, here)
         most = math.max(most, here)
      end

      -- the centroid of the field's power
      local function middle()
         local total, moment = 0, 0
         for k = 2, #along do
            local share = (along[k] - along[k - 1]) * (power[k] + power[k - 1])
            total = total + share
            moment = moment + share * (along[k] + along[k - 1])
         end
         return moment / total / 2
      end

      local function finish()
         local moved = most > 0 and middle() or 0
         if most > 0 then
            arms = arms + 1
            self.settled = arms >= 2 and (math.abs(moved) <= SETTLED_M or arms >= MOST_ARMS)
         end
         begin(centre_n + moved * math.cos(course), centre_e + moved * math.sin(course))
         course = course + math.pi / 2
      end

      -- continue the arm, or complete it
      local function judge()
         local first_low, last_low, reach = 0, 0, SHORTEST_M
         if most > 0 then
            local low = most * LOW^-6
            local first, last = 1, #along
            while power[first] < low do
               first = first + 1
            end
            while power[last] < low do
               last = last - 1
            end
            first_low, last_low = along[first], along[last]
            reach = math.max(SHORTEST_M, REACH * most^(-1 / 6))
         end
         local ahead = along[#along] >= last_low + reach
         local behind = along[1] <= first_low - reach
         sense = ahead and -1 or 1
         complete = (ahead and behind) or #along >= MOST_READINGS
      end

      -- use a reading
      function self.hear(now, n, e, d)
         n, e = n - centre_n, e - centre_e
         on_arm = on_arm or math.sqrt(n * n + e * e) <= AT_M
         if not on_arm or complete then
            return
         end
         sum_along = sum_along + n * math.cos(course) + e * math.sin(course)
         sum_power = sum_power + (d and d^-6 or 0)
         count = count + 1
         if not last_ms or now - last_ms >= TOGETHER_MS then
            keep(sum_along / count, sum_power / count)
            sum_along, sum_power, count, last_ms = 0, 0, 0, now
            judge()
         end
      end

      -- where to fly from there: to the centre, and then ahead on the arm. A complete arm is counted here, so that hear
      -- leaves the instructions of a pass for that
      function self.target(n, e)
         if complete then
            finish()
         end
         if not on_arm then
            return centre_n, centre_e
         end
         local c, s = math.cos(course), math.sin(course)
         local place = (n - centre_n) * c + (e - centre_e) * s + 2 * sense
         return centre_n + place * c, centre_e + place * s
      end

      function self.centre()
         return centre_n, centre_e
      end

      begin(centre_n, centre_e)
      return self
   end
end

local Flux
do
   local K = 0.8                 -- 1/m; speed * K d / sqrt(1 + (K d)^2)
   local RISE = 1.08             -- d rises above this multiple of its minimum
   local FALL = 0.7              -- d has fallen below this share of its first value
   local MOST_TURNS = 3          -- turns without a fall of d
   local SMOOTH_MS = 1000        -- time constant
   local SILENCE_MS = 3000       -- without a signal: turn back, then again after twice the time, and so on

   --[[
      along the flux line until d rises after it has fallen, then the cross. A flux line has two ways: d falls along the
      right one, and where it rises the other one is right. Made with the speed not to be exceeded
   --]]
   function Flux(speed)
      local self = {}
      local course = nil                     -- nil before the first signal
      local smooth = 0                       -- d
      local first, least = 0, math.huge      -- d at the choice of the course, and least d since; huge: no course yet
      local place_n, place_e = 0, 0          -- place of the least d
      local turns = 0
      local heard_ms = nil                   -- time of the last signal, or of the last turn back
      local patience_ms = SILENCE_MS
      local cross = nil

      -- choose the course again, at this d
      local function take(d, n, e)
         smooth, first, least, place_n, place_e = d, d, d, n, e
      end

      local function measure(now, n, e, d)
         if least == math.huge then
            take(d, n, e)
         end
         if heard_ms then
            smooth = smooth + (d - smooth) * (1 - math.exp((heard_ms - now) / SMOOTH_MS))
         end
         heard_ms, patience_ms = now, SILENCE_MS
         if smooth < least then
            least, place_n, place_e = smooth, n, e
         end
      end

      -- continue, turn round, or begin the cross
      local function decide(n, e, inner)
         if inner then
            cross = Cross(n, e, course)
         elseif smooth > RISE * least then
            if least < FALL * first or turns >= MOST_TURNS then
               cross = Cross(place_n, place_e, course)
            else
               turns = turns + 1
               course = course + math.pi
               take(smooth, n, e)
            end
         end
      end

      -- turn back to the least d and beyond; choose the course again there
      local function turn_back(now, n, e)
         turns = turns + (least < math.huge and 1 or 0)
         least = math.huge
         course = math.atan(place_e - e, place_n - n)
         heard_ms, patience_ms = now, 2 * patience_ms
      end

      -- use a frame: its time and place, the flux line's bearing, d, and true in the inner zone
      function self.hear(now, n, e, bearing, d, inner)
         if cross then
            smooth = d or smooth
            cross.hear(now, n, e, d)
         elseif d then
            if not course then
               course = bearing
            elseif not inner then
               course = math.cos(bearing - course) >= 0 and bearing or bearing + math.pi
            end
            measure(now, n, e, d)
            decide(n, e, inner)
         elseif course and now - heard_ms > patience_ms then
            turn_back(now, n, e)
         end
      end

      -- the velocity to fly: north, east, m/s; slower near the transmitter
      function self.velocity(n, e)
         if not course then
            return 0, 0
         end
         local x = K * smooth
         local v = speed * x / math.sqrt(1 + x * x)
         if not cross then
            return v * math.cos(course), v * math.sin(course)
         end
         local to_n, to_e = cross.target(n, e)
         local left = math.sqrt((to_n - n)^2 + (to_e - e)^2)
         local share = left > 0 and math.min(1, v / left) or 0
         return (to_n - n) * share, (to_e - e) * share
      end

      -- north and east of the transmitter, nil while it is not known
      function self.found()
         if cross and cross.settled then
            return cross.centre()
         end
         return nil
      end

      return self
   end
end

--[[
   the plane of the places with a signal, above all the near ones. Over a slope the vehicle flies on
   such a plane, and where d is least the transmitter is below it at a right angle: farther up the slope
--]]
local function Plane()
   local self = {least = math.huge}                  -- of d
   local w, n, e, u, nn, ee, ne, nu, eu = 0, 0, 0, 0, 0, 0, 0, 0, 0 -- sums of weights, places, and their products

   function self.take(d, north, east, up)
      local share = d > 0 and d^-6 or 0
      self.least = math.min(self.least, d)
      w, n, e, u = w + share, n + share * north, e + share * east, u + share * up
      nn, ee, ne = nn + share * north * north, ee + share * east * east, ne + share * north * east
      nu, eu = nu + share * north * up, eu + share * east * up
   end

   -- from the place of the least d to the transmitter, north and east
   function self.to_transmitter()
      local v_n, v_e, c, c_n, c_e = nn - n * n / w, ee - e * e / w, ne - n * e / w, nu - n * u / w, eu - e * u / w
      local det = v_n * v_e - c * c
      if det <= 1e-3 * v_n * v_e then                -- places on a line define no plane
         return 0, 0
      end
      local rise_n, rise_e = (c_n * v_e - c_e * c) / det, (c_e * v_n - c_n * c) / det
      local share = self.least / math.sqrt(1 + rise_n^2 + rise_e^2)
      return share * rise_n, share * rise_e
   end

   return self
end

if ... then -- required, to inspect the strategy
   return {Cross = Cross, Flux = Flux, Plane = Plane}
end

-- bind a parameter to a variable given
local function bind_param(name)
   local p = Parameter()
   assert(p:init(name), string.format('could not find %s parameter', name))
   return p
end

-- add a parameter and bind it to a variable
local function bind_add_param(name, idx, default_value)
   assert(param:add_param(PARAM_TABLE_KEY, idx, name, default_value), string.format('could not add param %s', name))
   return bind_param(PARAM_TABLE_PREFIX .. name)
end

-- setup script specific parameters
assert(param:add_table(PARAM_TABLE_KEY, PARAM_TABLE_PREFIX, 10), 'could not add param table')

--[[
  // @Param: ARVS_ENABLE
  // @DisplayName: ARVA search enable
  // @Description: Search for a transmitter when flying in GUIDED. 1 is for one search: it goes back to 0 at its end, whatever the end. 2 searches while the switch of ARVS_SWITCH is high
  // @Values: 0:Disabled,1:Enabled for one search,2:By switch
  // @User: Standard
--]]
local ARVS_ENABLE = bind_add_param("ENABLE", 1, 0)

--[[
  // @Param: ARVS_SWITCH
  // @DisplayName: ARVA search switch
  // @Description: Auxiliary function of the switch that searches, the value of RCn_OPTION: 300 is Scripting1, 307 is Scripting8
  // @Range: 300 307
  // @Increment: 1
  // @User: Standard
--]]
local ARVS_SWITCH = bind_add_param("SWITCH", 2, 300)

--[[
  // @Param: ARVS_SPEED
  // @DisplayName: ARVA search speed
  // @Description: Horizontal speed that a search does not exceed
  // @Range: 0.2 3
  // @Units: m/s
  // @User: Standard
--]]
local ARVS_SPEED = bind_add_param("SPEED", 3, 1)

--[[
  // @Param: ARVS_ALT
  // @DisplayName: ARVA search height
  // @Description: Height held in a search above the ground, by a downward rangefinder. Without one a search stays as high as it begins, and climbs to this height above the terrain database, else above home
  // @Range: 0.5 20
  // @Units: m
  // @User: Standard
--]]
local ARVS_ALT = bind_add_param("ALT", 4, 2)

--[[
  // @Param: ARVS_TERRAIN
  // @DisplayName: ARVA search uses the terrain database
  // @Description: Whether a search without a rangefinder stays as high above the terrain database as it begins, else above home. The database's errors are metres
  // @Values: 0:No,1:Yes
  // @User: Standard
--]]
local ARVS_TERRAIN = bind_add_param("TERRAIN", 5, 1)

--[[
  // @Param: ARVS_RADIUS
  // @DisplayName: ARVA search radius
  // @Description: A search ends that far from where it began
  // @Range: 10 500
  // @Units: m
  // @User: Standard
--]]
local ARVS_RADIUS = bind_add_param("RADIUS", 6, 150)

--[[
  // @Param: ARVS_TIME
  // @DisplayName: ARVA search time
  // @Description: A search ends after this time
  // @Range: 30 3600
  // @Units: s
  // @User: Standard
--]]
local ARVS_TIME = bind_add_param("TIME", 7, 900)

local function say(severity, ...)
   gcs:send_text(severity, "ARVS: " .. string.format(...))
end

-- the driver is in the folder of scripts, which require does not search by itself
for folder in package.path:gmatch("([^;]-)modules/%?%.lua") do
   package.path = package.path .. ";" .. folder .. "?.lua"
end
local has_driver, driver = pcall(require, "arva_receiver")
if not has_driver then
   say(MAV_SEVERITY.ERROR, "arva_receiver.lua is missing")
   return
end

local sticks = {}
for _, name in ipairs({"ROLL", "PITCH", "YAW"}) do
   sticks[#sticks + 1] = rc:get_channel(math.floor(bind_param("RCMAP_" .. name):get()))
end
local throttle = rc:get_channel(math.floor(bind_param("RCMAP_THROTTLE"):get()))

-- the state of the vehicle

-- "roll", "pitch" or "yaw", radians; older versions have the second name
local function angle(name)
   return (ahrs["get_" .. name .. "_rad"] or ahrs["get_" .. name])(ahrs)
end

-- above the ground, m; nil if the rangefinder does not measure it. The beam of a tilted vehicle is longer than
-- the height
local function measured_height()
   if rangefinder and rangefinder:status_orient(ROTATION_PITCH_270) == RANGEFINDER_GOOD then
      local beam = rangefinder.distance_orient and rangefinder:distance_orient(ROTATION_PITCH_270)
         or rangefinder:distance_cm_orient(ROTATION_PITCH_270) * 0.01
      return beam * math.cos(angle("roll")) * math.cos(angle("pitch"))
   end
   return nil
end

-- above the terrain database, m; nil outside of it
local function height_above_terrain()
   return terrain and ARVS_TERRAIN:get() == 1 and terrain:height_above_terrain(false) or nil
end

local function height_above_home()
   return -ahrs:get_relative_position_D_home()
end

local function is_flying()
   return arming:is_armed() and vehicle:get_likely_flying() and not vehicle:is_taking_off()
end

local function throttle_in_middle()
   return rc:has_valid_input() and math.abs(throttle:norm_input_ignore_trim()) <= STICK_MIDDLE
end

local PILOT = "pilot input"

-- the reason against a search, or nil. rest: position of the throttle stick at its start
local function objection(rest)
   if rc:has_valid_input() then
      for k = 1, #sticks do
         if math.abs(sticks[k]:norm_input_dz()) > STICK then
            return PILOT
         end
      end
      if math.abs(throttle:norm_input_ignore_trim() - rest) > STICK then
         return PILOT
      end
   end
   if battery:has_failsafed() then
      return "low battery"
   end
   if fence and fence:get_breaches() ~= 0 then
      return "fence breached"
   end
   return nil
end

-- of a transmitter
local function name(id)
   return id == NO_ID and "?" or tostring(id)
end

-- degrees and ten-millionths, too many digits for one of ArduPilot's numbers
local function degrees(value)
   return string.format("%s%d.%07d", value < 0 and "-" or "", math.abs(value) // 10000000, math.abs(value) % 10000000)
end

--[[
   the search. HOLDING: it is over, the vehicle hovers in GUIDED, and goes to LOITER when the pilot is to have it and
   the throttle stick is in the middle
--]]
local IDLE, SEARCHING, HOLDING = 0, 1, 2

local receiver
local now = millis():toint()
local state = IDLE
local flux, plane = nil, nil
local target, target_d, heard_ms = nil, 0, 0   -- the chosen transmitter, its last distance in m and its time
local sample = nil                             -- reading of the target for the strategy's next step
local begin_n, begin_e, begin_ms, begin_yaw, begin_throttle = 0, 0, 0, 0, 0
local position_ms, frame_ms = 0, 0
local sequence = nil                           -- of the last frame
local place = nil                              -- of the transmitter, when it is found
local same                                     -- the target's last reading and its first place; over: too far away
local measured_ms = nil                        -- last measurement of the rangefinder in this search
local assumed_height, assumed_wanted           -- without it: a function, nil outside of the database; height to hold, m
local begin_home = 0                           -- down of home at the start
local checked = nil                            -- a place close by, and the rangefinder's height there
local sinking = false                          -- and not flying on
local spent = false                            -- the request was used for a search
local wants_loiter, told = false, ""

-- once
local function tell(severity, ...)
   local text = string.format(...)
   if text ~= told then
      told = text
      say(severity, "%s", text)
   end
end

-- only in GUIDED: other modes are the pilot's, and some of them would obey
local function steer(v_n, v_e, v_d)
   if vehicle:get_mode() ~= MODE_GUIDED then
      return
   end
   local velocity = Vector3f()
   velocity:x(v_n)
   velocity:y(v_e)
   velocity:z(v_d)
   vehicle:set_target_velaccel_NED(velocity, Vector3f(), true, begin_yaw, false, 0, false)
end

-- the vehicle's place, north, east and down of the EKF's origin, m; nil if unknown
local function position()
   local place = ahrs:get_relative_position_NED_origin()
   if place then
      return place:x(), place:y(), place:z()
   end
   return nil
end

-- use a frame's reading of the chosen transmitter: the nearest, with a margin against noise
local function on_frame(frame)
   local n, e, down = position()
   if frame.sequence == sequence then
      return
   end
   sequence, frame_ms = frame.sequence, now
   if state ~= SEARCHING or not n then
      return
   end
   local nearest, mine = nil, nil
   for k = 1, frame.n do
      local d = frame.d[k]
      if d > 0 and not frame.marked[k] and (not nearest or d < frame.d[nearest]) then
         nearest = k
      end
      if d > 0 and frame.id[k] == target and (not mine or d < frame.d[mine]) then
         mine = k
      end
   end
   if nearest and nearest ~= mine and not place and (not target or frame.d[nearest] * 0.01 < NEARER * target_d) then
      target, mine = frame.id[nearest], nearest
      flux, plane = Flux(ARVS_SPEED:get()), Plane()
      say(MAV_SEVERITY.INFO, "going for transmitter %s, %.1f m away", name(target), frame.d[mine] * 0.01)
   end
   sample = {ms = now, n = n, e = e}
   if mine then
      target_d, heard_ms = frame.d[mine] * 0.01, now
      plane.take(target_d, n - begin_n, e - begin_e, -down)
      sample.bearing = angle("yaw") + math.rad(frame.delta[mine])
      sample.d, sample.inner = target_d, frame.zone[mine] == INNER
      if not same or same.d ~= frame.d[mine] or same.delta ~= frame.delta[mine] then
         same = {d = frame.d[mine], delta = frame.delta[mine], n = n, e = e}
      end
      same.over = (n - same.n)^2 + (e - same.e)^2 > SAME_M^2
   end
end

local function is_asked_for()
   local enable = ARVS_ENABLE:get()
   return enable == 1 or (enable == 2 and rc:get_aux_cached(math.floor(ARVS_SWITCH:get())) == SWITCH_HIGH)
end

-- end the search: hover. for_pilot: the pilot gets the vehicle
local function finish(for_pilot)
   steer(0, 0, 0)
   state, spent, wants_loiter = HOLDING, true, for_pilot
   if ARVS_ENABLE:get() == 1 then
      ARVS_ENABLE:set_and_save(0)
   end
end

local function hand_back(...)
   say(MAV_SEVERITY.WARNING, "%s: search ends", string.format(...))
   finish(true)
end

local function begin()
   local n, e, down = position()
   local rest = throttle:norm_input_ignore_trim()
   local why_not = objection(rest) or (not receiver.healthy and "no receiver")
      or (receiver.status & UNFIT ~= 0 and "receiver cannot search") or (not n and "no position")
   if why_not then
      tell(MAV_SEVERITY.WARNING, "cannot search: %s", why_not)
      return
   end
   begin_n, begin_e, begin_ms, begin_yaw, begin_throttle = n, e, now, math.deg(angle("yaw")), rest
   state, flux, target, sample, heard_ms, position_ms, told = SEARCHING, nil, nil, nil, now, now, ""
   say(MAV_SEVERITY.INFO, "search begins")
   frame_ms, same, place, checked, sinking, begin_home = now, nil, nil, nil, false, down + height_above_home()
   measured_ms = measured_height() and now or nil
   assumed_height = height_above_terrain() and height_above_terrain or height_above_home
   assumed_wanted = assumed_height()
   if not measured_ms and assumed_wanted > ARVS_ALT:get() + 1 then
      say(MAV_SEVERITY.WARNING, "no rangefinder: stays at %.0f m", assumed_wanted)
   end
end

-- the vehicle still has to fly there
local function on_found(n, e)
   place = {n = n, e = e}
   local there = ahrs:get_origin()
   if there then
      there:offset(n, e)
      say(MAV_SEVERITY.NOTICE, "found %s at %s %s +-%dm", name(target), degrees(there:lat()), degrees(there:lng()),
          math.ceil(SURE * plane.least))
   end
end

-- the reason to end the search, or nil
local function limit(n, e, down)
   local HOME_M = 0.5
   if not receiver.healthy then
      return "receiver lost"
   end
   if now - frame_ms > REPEATS_MS then
      return "receiver repeats itself"
   end
   if receiver.status & UNFIT ~= 0 then
      return "receiver cannot search"
   end
   if same and same.over then
      return "the reading does not change"
   end
   if now - position_ms > NO_POSITION_MS then
      return "no position"
   end
   if measured_ms and now - measured_ms > NO_RANGE_MS then
      return "rangefinder lost"
   end
   if n and not measured_ms and math.abs(down + height_above_home() - begin_home) > HOME_M then
      return "home moved"
   end
   if now - heard_ms > DEAF_MS then
      return string.format("no signal for %d s", DEAF_MS // 1000)
   end
   if now - begin_ms > 1000 * ARVS_TIME:get() then
      return string.format("not found in %d s", math.floor(ARVS_TIME:get()))
   end
   if n and (n - begin_n)^2 + (e - begin_e)^2 > ARVS_RADIUS:get()^2 then
      return string.format("%d m away", math.floor(ARVS_RADIUS:get()))
   end
   return objection(begin_throttle)
end

--[[
   the height, m, nil while it is not known; and the one wanted. Only what the rangefinder measures is the ground: a map
   and home let the vehicle climb, and sink no lower than where the search began
--]]
local function heights(n, e, down)
   local LEAST_ALT = 0.5 -- of the parameter, whose range the autopilot does not enforce
   local AT_M, STEP_M = 0.4, 1.5    -- at one place the ground has no larger step down
   local SUNK_M, SHARE = 0.8, 0.75  -- and after this descent of the vehicle, no step of this share of it
   local above, wanted = measured_height(), math.max(LEAST_ALT, ARVS_ALT:get())
   local sunk = checked and down - checked.down or 0
   local fallen = above and checked and sunk + above - checked.above or 0
   if above and fallen < (sunk < SUNK_M and STEP_M or SHARE * sunk) then
      measured_ms = now
      if not checked or sunk < 0 or (n - checked.n)^2 + (e - checked.e)^2 > AT_M^2 then
         checked = {n = n, e = e, down = down, above = above}
      end
   elseif measured_ms then
      above = nil
   else
      above, wanted = assumed_height(), math.max(wanted, assumed_wanted)
   end
   return above, wanted
end

local function fly()
   local THERE_M = 0.3           -- from the place found: hover
   local BEGIN_M, END_M = 0.4, 0.05 -- above the height wanted: begin and end of a descent
   local SINK_GAIN = 1.0         -- 1/s
   local CLIMB_GAIN = 2.0        -- 1/s: on steeper ground the vehicle is farther below the height wanted
   local CLIMB_SPEED = 1.0       -- m/s
   local n, e, down = position()
   position_ms = n and now or position_ms
   local why = limit(n, e, down)
   if why then
      hand_back(why)
      return
   end
   if not n then
      steer(0, 0, 0)
      return
   end
   local above, wanted = heights(n, e, down)
   if not above then
      steer(0, 0, 0)
      return
   end
   local v_n, v_e = 0, 0
   if flux and now - frame_ms <= SILENT_MS then
      if not place then
         v_n, v_e = flux.velocity(n, e)
         local found_n, found_e = flux.found()
         if found_n then
            local to_n, to_e = plane.to_transmitter()
            on_found(found_n + to_n, found_e + to_e)
         end
      end
      if place then -- the ground may rise on the way there, so the height is held as before
         v_n, v_e = place.n - n, place.e - e
         local left = math.sqrt(v_n^2 + v_e^2)
         if left <= THERE_M then
            finish(false)
            local hover = Vector3f()
            hover:x(place.n)
            hover:y(place.e)
            hover:z(down)
            vehicle:set_target_pos_NED(hover, true, begin_yaw, false, 0, false, false)
            return
         end
      end
      local share = math.max(0, math.min(1, ARVS_SPEED:get() / math.sqrt(v_n^2 + v_e^2)))
      v_n, v_e = share * v_n, share * v_e
   end
   -- sink only without flying on: a rangefinder that is stuck then contradicts the descent
   sinking = above > wanted + (sinking and END_M or BEGIN_M)
   -- if the ground rises faster than the vehicle climbs, it slows down, and stops at three quarters of the height
   local share = sinking and 0 or math.max(0, math.min(1, 4 * above / wanted - 3))
   v_n, v_e = share * v_n, share * v_e
   local v_d = (above < wanted and CLIMB_GAIN or SINK_GAIN) * (above - wanted)
   v_d = math.max(-CLIMB_SPEED, math.min(sinking and CLIMB_SPEED or 0, v_d))
   steer(v_n, v_e, v_d)
   logger:write("ARVS", "Id,N,E,Hgt,VN,VE,VD,D", "Bfffffff", "#mmmnnnm", "-0000000",
                target or NO_ID, n - begin_n, e - begin_e, above, v_n, v_e, v_d, target_d)
end

-- after the search, in GUIDED
local function hold()
   wants_loiter = wants_loiter or objection(begin_throttle) == PILOT
   if wants_loiter and throttle_in_middle() then
      vehicle:set_mode(MODE_LOITER)
   elseif wants_loiter and rc:has_valid_input() then
      tell(MAV_SEVERITY.WARNING, "throttle to the middle for LOITER")
   end
end

local function search()
   local in_guided, asked_for = vehicle:get_mode() == MODE_GUIDED and arming:is_armed(), is_asked_for()
   if not asked_for then
      spent = false
   end
   if state == SEARCHING and not in_guided then
      say(MAV_SEVERITY.INFO, "not in GUIDED any more: search ends")
      finish(false)
   elseif state == SEARCHING and not asked_for then
      hand_back("switched off")
   elseif state == SEARCHING then
      fly()
   elseif asked_for and not spent then
      state = IDLE
      if in_guided and is_flying() then
         begin()
      else
         tell(MAV_SEVERITY.INFO, "search begins when flying in GUIDED")
      end
   elseif state == HOLDING and in_guided then
      hold()
   else
      state, told = IDLE, ""
   end
end

receiver = driver.start(now, on_frame)
if not receiver then
   return
end

local search_ms = now

-- driver, strategy and steering take turns, so that each has all instructions of a pass
local function update()
   now = millis():toint()
   if now - search_ms >= SEARCH_MS then
      search_ms = now
      search()
      return 1
   end
   if sample and flux then
      flux.hear(sample.ms, sample.n, sample.e, sample.bearing, sample.d, sample.inner)
      sample = nil
      return 1
   end
   receiver.update(now)
   return UPDATE_MS
end

-- wrapper around update(). This calls update() and if update faults
-- then an error is displayed, but the script is not stopped
local function protected_wrapper()
   local success, result = pcall(update)
   if not success then
      say(MAV_SEVERITY.ERROR, "internal error: %s", result)
      if state == SEARCHING then
         finish(true)
      end
      -- when we fault we run the update function again after 1s, slowing it
      -- down a bit so we don't flood the console with errors
      return protected_wrapper, 1000
   end
   return protected_wrapper, result
end

return protected_wrapper()
