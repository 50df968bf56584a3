--[[
 Driver for an ARVA receiver: an avalanche transceiver (457 kHz) on a serial port, SERIALn_PROTOCOL 28

 Reads its binary frames (PROTOCOL.md of firmware_proto), sends the first channel to the ground station, logs all
 channels, and says when the receiver appears, is lost and comes back. See arva_receiver.md
--]]

---@diagnostic disable: param-type-mismatch

local PARAM_TABLE_KEY = 145
local PARAM_TABLE_PREFIX = "ARVA_"

local MAV_SEVERITY = {EMERGENCY=0, ALERT=1, CRITICAL=2, ERROR=3, WARNING=4, NOTICE=5, INFO=6, DEBUG=7}

local UPDATE_MS = 10
local MOST_WORK = 240      -- of the decoder in one pass, see there
local HEALTH_MS = 3000     -- without a good frame the receiver is lost
local QUIET_MS = 2000      -- without a good frame the port is knocked at
local KNOCK_MS = 1000
local COUNTERS_MS = 1000

local SYNC_0 = 0xA4
local SYNC_1 = 0x57
local VERSION = 1
local HEAD_BYTES = 7       -- up to the number of channels
local CHANNEL_BYTES = 6
local LENGTH_1 = 9         -- of the payload of 1 channel and of 16
local LENGTH_16 = 99
local RESTART = 16         -- a number below it where more frames than this would be missing: the receiver has restarted
local PAUSE_MS = 100       -- the bytes of one frame come without a pause as long as this
local RING = 127           -- mask; the largest frame has 105 bytes
local REFUSAL_WORK = 4     -- work: as much as to take a byte, about 20 instructions
local FRAME_WORK = 12
local CHANNEL_WORK = 5

--[[
   the decoder of binary frames. A candidate that is refused costs one byte, never those behind it, and so does one
   that is not whole 100 ms after its own first byte. Times are integers, ms, and may wrap

   on_frame(frame) gets each good frame, in one table that is used again for the next: sequence, status, n, time (when
   its last byte came) and the columns id, zone, marked, d (cm), delta (degrees), of which 1 to n are this frame's
--]]
local function Decoder(on_frame)
   local self = {good = 0, bad_crc = 0, dropped = 0, lost = 0}
   local frame = {id = {}, zone = {}, marked = {}, d = {}, delta = {}}
   local held, came = {}, {}     -- rings: a byte, when it came
   local first, count = 0, 0     -- of the candidate in them
   local wait = 1                -- for so many bytes before it is looked at again
   local work = 0                -- that may still be done in this call
   local sequence = nil
   for k = 0, RING do
      held[k], came[k] = 0, 0
   end

   -- the byte at an offset from the candidate's first
   local function at(offset)
      return held[first + offset & RING]
   end

   -- the bytes to have before the candidate can be judged, 0 when it is a false one
   local function needs()
      if at(0) ~= SYNC_0 or (count > 1 and at(1) ~= SYNC_1) or (count > 2 and at(2) ~= VERSION) then
         return 0
      end
      if count < 4 then
         return count + 1
      end
      local length = at(3)
      if length < LENGTH_1 or length > LENGTH_16 or length % CHANNEL_BYTES ~= 3 then
         return 0
      end
      if count < HEAD_BYTES then
         return HEAD_BYTES
      end
      return length == 3 + CHANNEL_BYTES * at(6) and length + 6 or 0
   end

   -- CRC-16/MCRF4XX, MAVLink's, of what is between sync and CRC
   local function crc(size)
      local register = 0xFFFF
      for k = first + 2, first + size - 3 do
         local x = (register ~ held[k & 127]) & 0xFF
         x = (x ~ x << 4) & 0xFF
         register = register >> 8 ~ x << 8 ~ x << 3 ~ x >> 4
      end
      return register
   end

   local function drop(bytes)
      first, count, wait = first + bytes & RING, count - bytes, 1
   end

   local function refuse()
      self.dropped = self.dropped + 1
      drop(1)
   end

   local function int16(low, high)
      return low + 256 * (high < 128 and high or high - 256)
   end

   local function deliver(size)
      frame.sequence, frame.status, frame.n = at(4), at(5), at(6)
      frame.time = came[first + size - 1 & RING]
      for k = 1, frame.n do
         local p = first + CHANNEL_BYTES * k
         local zone = held[p + 2 & 127]
         frame.id[k], frame.zone[k], frame.marked[k] = held[p + 1 & 127], zone & 127, zone > 127
         frame.d[k] = int16(held[p + 3 & 127], held[p + 4 & 127])
         frame.delta[k] = int16(held[p + 5 & 127], held[p + 6 & 127])
      end
      drop(size)
      self.good = self.good + 1
      if sequence and frame.sequence ~= sequence then
         local gap = frame.sequence - sequence - 1 & 0xFF
         if frame.sequence >= RESTART or gap <= RESTART then
            self.lost = self.lost + gap
         end
      end
      sequence = frame.sequence
      work = work - FRAME_WORK - CHANNEL_WORK * frame.n
      on_frame(frame)
   end

   -- judge what is held until a candidate is not whole; false when that is more than the work allows
   local function settle()
      while count >= wait do
         local size = needs()
         if size > count then
            wait = size
            return true
         end
         if work <= 0 then
            return false
         end
         work = work - REFUSAL_WORK - size
         if size > 0 and crc(size) == at(size - 2) | at(size - 1) << 8 then
            deliver(size)
         else
            self.bad_crc = self.bad_crc + (size > 0 and 1 or 0)
            refuse()
         end
      end
      return true
   end

   -- drop the candidates that are too old; false like settle
   local function tell_time(now)
      while settle() do
         if count == 0 or now - came[first] < PAUSE_MS then
            return true
         end
         refuse()
      end
      return false
   end

   --[[
      take what port:read() gives until it gives less than 0, or so much has been done as a byte costs most_work times;
      the rest is done in the next calls. False when there is a rest
   --]]
   function self.read(port, now, most_work)
      work = most_work
      if not tell_time(now) then
         return false
      end
      while work > 0 do
         local byte = port:read()
         if byte < 0 then
            return true
         end
         work = work - 1
         if count == 0 and byte ~= SYNC_0 then
            self.dropped = self.dropped + 1
         else
            local k = first + count & RING
            held[k], came[k], count = byte, now, count + 1
            if count >= wait and not settle() then
               return false
            end
         end
      end
      return false
   end

   return self
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
assert(param:add_table(PARAM_TABLE_KEY, PARAM_TABLE_PREFIX, 8), 'could not add param table')

--[[
  // @Param: ARVA_ENABLE
  // @DisplayName: ARVA receiver enable
  // @Description: Enable the driver of the ARVA receiver
  // @Values: 0:Disabled,1:Enabled
  // @RebootRequired: True
  // @User: Standard
--]]
local ARVA_ENABLE = bind_add_param("ENABLE", 1, 1)

--[[
  // @Param: ARVA_PORT
  // @DisplayName: ARVA receiver port
  // @Description: Which of the serial ports with SERIALn_PROTOCOL 28 the receiver is on, in the order of their numbers
  // @Range: 1 4
  // @Increment: 1
  // @RebootRequired: True
  // @User: Standard
--]]
local ARVA_PORT = bind_add_param("PORT", 2, 1)

--[[
  // @Param: ARVA_BAUD
  // @DisplayName: ARVA receiver baud rate
  // @Description: Baud rate of the receiver. It takes the place of SERIALn_BAUD
  // @Range: 19200 921600
  // @RebootRequired: True
  // @User: Advanced
--]]
local ARVA_BAUD = bind_add_param("BAUD", 3, 115200)

local function say(severity, ...)
   gcs:send_text(severity, "ARVA: " .. string.format(...))
end

--[[
   open the port at the time now, ms. Returns a table, or nil when the driver is off or has no port:
   update(now): to be called every 10 ms; hands each good frame to on_frame too, if that is given
   healthy: whether a good frame came in the last 3 s
--]]
local function start(now, on_frame)
   local number = math.floor(ARVA_PORT:get())
   if ARVA_ENABLE:get() ~= 1 then
      say(MAV_SEVERITY.INFO, "disabled")
      return nil
   end
   local port = serial:find_serial(number - 1)
   if not port then
      say(MAV_SEVERITY.ERROR, "no port %d with SERIALn_PROTOCOL 28", number)
      return nil
   end
   port:begin(math.floor(ARVA_BAUD:get()))
   say(MAV_SEVERITY.INFO, "driver started on scripting port %d", number)

   local self = {healthy = false}
   local decoder
   local heard = false          -- whether there was ever a good frame
   local waiting = true         -- for a good frame or the end of the health time-out
   local frame_ms = now         -- when the last good frame came
   local knock_ms = now
   local counters_ms = now
   local dropped = 0            -- as counted at the last good frame

   local function publish(frame)
      gcs:send_named_float("ARVA1_D", frame.d[1])
      gcs:send_named_float("ARVA1_DIR", frame.delta[1])
      gcs:send_named_float("ARVA1_ID", frame.id[1])
      gcs:send_named_float("ARVA1_ZONE", frame.zone[1])
      for k = 1, frame.n do
         logger:write("ARVA", "Ch,Id,Zone,Mark,D,Dir,Seq,Stat,N", "BBBBhhBBB", "#---md---", "----B0---",
                      k, frame.id[k], frame.zone[k], frame.marked[k] and 1 or 0, frame.d[k], frame.delta[k],
                      frame.sequence, frame.status, frame.n)
      end
   end

   decoder = Decoder(function(frame)
      if not heard then
         say(MAV_SEVERITY.INFO, "receiver found, channels: %d", frame.n)
      elseif not self.healthy then
         say(MAV_SEVERITY.INFO, "receiver is back after %d s", (frame.time - frame_ms) // 1000)
      end
      heard, waiting, self.healthy = true, true, true
      frame_ms, dropped = frame.time, decoder.dropped
      if on_frame then
         on_frame(frame)
      end
      publish(frame)
   end)

   -- that a port on USB was unplugged may be noticed, and the port opened again, only when something is written
   local function knock()
      if now - frame_ms >= QUIET_MS and now - knock_ms >= KNOCK_MS then
         knock_ms = now
         port:write(0)
      end
   end

   local function watch()
      if waiting and now - frame_ms >= HEALTH_MS then
         waiting, self.healthy = false, false
         say(MAV_SEVERITY.WARNING, heard and "receiver lost" or "no receiver")
         if decoder.dropped > dropped then
            say(MAV_SEVERITY.WARNING, "%d bytes in no frame: baud rate?", decoder.dropped - dropped)
         end
      end
   end

   local function log_counters()
      if now - counters_ms >= COUNTERS_MS then
         counters_ms = now
         logger:write("ARVC", "Good,Crc,Drop,Lost,Up", "IIIIB", decoder.good, decoder.bad_crc, decoder.dropped,
                      decoder.lost, self.healthy and 1 or 0)
      end
   end

   function self.update(time)
      now = time
      decoder.read(port, now, MOST_WORK)
      knock()
      watch()
      log_counters()
   end

   return self
end

if ... then -- required by another script
   return {Decoder = Decoder, start = start}
end

-- arva_search.lua next to this file reads the port itself; two readers would tear the frames
local function is_read_by_search()
   for folder in package.path:gmatch("([^;]-)modules/%?%.lua") do
      local file = io.open(folder .. "arva_search.lua")
      if file then
         file:close()
         return true
      end
   end
   return false
end

if is_read_by_search() then
   say(MAV_SEVERITY.INFO, "the receiver is read by arva_search.lua")
   return
end

local receiver = start(millis():toint())
if not receiver then
   return
end

-- wrapper around update(). This calls update() and if update faults
-- then an error is displayed, but the script is not stopped
local function protected_wrapper()
   local success, err = pcall(receiver.update, millis():toint())
   if not success then
      say(MAV_SEVERITY.ERROR, "internal error: %s", err)
      -- when we fault we run the update function again after 1s, slowing it
      -- down a bit so we don't flood the console with errors
      return protected_wrapper, 1000
   end
   return protected_wrapper, UPDATE_MS
end

return protected_wrapper()
