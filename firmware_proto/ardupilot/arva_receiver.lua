--[[
 Driver for an ARVA receiver: an avalanche transceiver (457 kHz) on a serial port, SERIALn_PROTOCOL 28

 Reads its binary frames (PROTOCOL.md of firmware_proto), sends the first channel to the ground station, logs all
 channels, and reports when the receiver appears, is lost and comes back. See arva_receiver.md
--]]

---@diagnostic disable: param-type-mismatch

local PARAM_TABLE_KEY = 145
local PARAM_TABLE_PREFIX = "ARVA_"

local MAV_SEVERITY = {EMERGENCY=0, ALERT=1, CRITICAL=2, ERROR=3, WARNING=4, NOTICE=5, INFO=6, DEBUG=7}

local UPDATE_MS = 10
local MOST_WORK = 240      -- of the decoder in one pass, in units of REFUSAL_WORK below
local MOST_WORK_SHARED = 50 -- the same while a command waits for its answer
local MOST_CRC = 1         -- bytes while a command waits: one message a pass
local HEALTH_MS = 3000     -- without a good frame the receiver is lost
local QUIET_MS = 2000      -- without a good frame, write a byte to the port: see below
local KNOCK_MS = 1000
local COUNTERS_MS = 1000

local SYNC_0 = 0xA4
local SYNC_1 = 0x57
local VERSION = 1
local HEAD_BYTES = 7       -- up to the number of channels
local CHANNEL_BYTES = 6
local LENGTH_1 = 9         -- of the payload of 1 channel and of 16
local LENGTH_16 = 99
local RESTART = 16         -- a lower number after a gap of more frames than this: the receiver has restarted
local PAUSE_MS = 100       -- there is no pause of this length inside a frame
local RING = 127           -- mask; the largest frame has 105 bytes
local REFUSAL_WORK = 4     -- in units of the work for one byte, about 20 instructions
local FRAME_WORK = 12
local CHANNEL_WORK = 5

local VERSION_2 = 2        -- of messages
local ANSWER = 17          -- kinds of messages
local COMMAND = 16
local VECTORS = 1
local LEVELS = 2
local MESSAGE_HEAD_BYTES = 6
local MAX_VALUES = 4
local MAX_TEXT = 32
local ANSWER_MS = 1000     -- a command without an answer is sent again after this time
local TRIES = 3
local RESTART_CODE = 5
local CODES = {"identify", "mark", "unmark", "select", "restart", "channels", "scan", "search"}
local RESULTS = {[0] = "done", "refused", "unknown", "busy"}

--[[
   the decoder of binary frames. A refused candidate costs one byte, never those after it; so does a candidate that is
   incomplete 100 ms after its own first byte. Times are integers, ms, and may wrap

   on_frame(frame) gets each good frame, in one table that is reused for the next: sequence, status, n, time (of its
   last byte) and the columns id, zone, marked, d (cm), delta (degrees), of which 1 to n are this frame's
--]]
local function Decoder(on_frame)
   local self = {good = 0, bad_crc = 0, dropped = 0, lost = 0}
   local frame = {id = {}, zone = {}, marked = {}, d = {}, delta = {}}
   local held, came = {}, {}     -- rings: bytes, their times
   local first, count = 0, 0     -- start and length of the candidate in the rings
   local wait = 1                -- number of bytes missing before the next check
   local work = 0                -- work left in this call
   local sequence = nil
   for k = 0, RING do
      held[k], came[k] = 0, 0
   end

   -- the byte at an offset from the candidate's first byte
   local function at(offset)
      return held[first + offset & RING]
   end

   -- the number of bytes needed to judge the candidate; 0 for a false one
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

   -- CRC-16/MCRF4XX, MAVLink's, of the bytes between sync and CRC
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

   -- judge the held bytes up to an incomplete candidate; false if that takes more work than is allowed
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

-- CRC-16/MCRF4XX, one byte further
local function crc_step(register, byte)
   local x = (register ~ byte) & 0xFF
   x = (x ~ x << 4) & 0xFF
   return register >> 8 ~ x << 8 ~ x << 3 ~ x >> 4
end

local function uint16(body, k)
   return body[k] + 256 * body[k + 1]
end

local function int16_at(body, k)
   return body[k] + 256 * (body[k + 1] < 128 and body[k + 1] or body[k + 1] - 256)
end

local function int32_at(body, k)
   return uint16(body, k) + 0x10000 * int16_at(body, k + 2)
end

local function int32s(body, first, count)
   local values = {}
   for k = 1, count do
      values[k] = int32_at(body, first + 4 * (k - 1))
   end
   return values
end

-- printable ASCII without $ * and comma; nil for other text
local function text_of(body, first)
   local letters = {}
   for k = first, #body do
      local byte = body[k]
      if byte < 32 or byte > 126 or byte == 36 or byte == 42 or byte == 44 then
         return nil
      end
      letters[#letters + 1] = string.char(byte)
   end
   return #letters <= MAX_TEXT and table.concat(letters) or nil
end

-- the measurements for a frame: channels of `size` bytes; `more` reads the values of one kind only
local function measured(body, size, more)
   local n = body[3]
   if #body ~= 7 + size * n then
      return nil
   end
   local message = {sequence = body[1], status = body[2], n = n, time = int32_at(body, 4), channels = {}}
   for k = 1, n do
      local p = 8 + size * (k - 1)
      local channel = {id = body[p], zone = body[p + 1] & 127, marked = body[p + 1] > 127}
      if not more(channel, body, p + 2) then
         return nil
      end
      message.channels[k] = channel
   end
   return message
end

--[[
   the kinds of messages: whether a body can have a size, and what is in a body (a table of bytes), nil when it makes no
   sense. Amplitudes are in 0.01 nA/m, levels in 0.01 dB, periods in 0.1 ms, carriers in 0.1 Hz, ages in ms
--]]
local KINDS = {
   [COMMAND] = {
      fits = function(size) return size >= 2 and size <= 2 + 4 * MAX_VALUES and size % 4 == 2 end,
      parse = function(body)
         return {number = body[1], code = body[2], values = int32s(body, 3, #body // 4)}
      end,
   },
   [ANSWER] = {
      fits = function(size) return size >= 4 and size <= 4 + 4 * MAX_VALUES + MAX_TEXT end,
      parse = function(body)
         local n, result = body[4], RESULTS[body[3]]
         if not result or n > MAX_VALUES or 4 + 4 * n > #body then
            return nil
         end
         local text = text_of(body, 5 + 4 * n)
         return text and {number = body[1], code = body[2], result = result, values = int32s(body, 5, n), text = text}
      end,
   },
   [VECTORS] = {
      fits = function(size) return size >= 22 and size <= 247 and size % 15 == 7 end,
      parse = function(body)
         return measured(body, 15, function(channel, bytes, p)
            if bytes[p] > 16 then
               return false
            end
            local scale = 1 << bytes[p]
            channel.x = int16_at(bytes, p + 1) * scale
            channel.y = int16_at(bytes, p + 3) * scale
            channel.z = int16_at(bytes, p + 5) * scale
            channel.period, channel.carrier = uint16(bytes, p + 7), int16_at(bytes, p + 9)
            channel.age = uint16(bytes, p + 11)
            return true
         end)
      end,
   },
   [LEVELS] = {
      fits = function(size) return size >= 13 and size <= 103 and size % 6 == 1 end,
      parse = function(body)
         return measured(body, 6, function(channel, bytes, p)
            channel.level, channel.age = int16_at(bytes, p), uint16(bytes, p + 2)
            return true
         end)
      end,
   },
}

--[[
   the decoder of messages of version 2, of the kinds in `want`. It is given what the decoder of frames is given, and
   finds messages by the same rules. on_message(kind, message) gets each good one

   left: for how many bytes a CRC may still be made; candidates beyond that are refused, as false ones
--]]
local function MessageDecoder(want, on_message)
   local self = {good = 0, bad_crc = 0, dropped = 0, left = math.huge}
   local held, came = {}, {}     -- rings of 256: bytes, their times
   local first, count = 0, 0     -- start and length of the candidate in the rings
   local wait = 1                -- number of bytes missing before the next check

   local function at(offset)
      return held[first + offset & 255]
   end

   -- the bytes that the candidate needs, by its head so far; 0 if it is a false one
   local function needs()
      if held[first] ~= SYNC_0 or (count > 1 and held[first + 1 & 255] ~= SYNC_1)
            or (count > 2 and held[first + 2 & 255] ~= VERSION_2) then
         return 0
      end
      if count < MESSAGE_HEAD_BYTES then
         return count < 3 and count + 1 or MESSAGE_HEAD_BYTES
      end
      local kind = at(5) ~ at(4)
      return want[kind] and KINDS[kind].fits(at(3) - 2) and at(3) + 6 or 0
   end

   local function drop(bytes)
      first, count, wait = first + bytes & 255, count - bytes, 1
   end

   -- drop a false candidate's first byte, and all bytes after it that begin no candidate
   local function refuse()
      local k = 0
      repeat
         k = k + 1
      until k == count or held[first + k & 255] == SYNC_0
      self.dropped = self.dropped + k
      drop(k)
   end

   -- deliver the complete candidate; false if it is a false one
   local function deliver(size)
      if self.left <= 0 then
         return false
      end
      self.left = self.left - size
      local register, mask, kind = 0xFFFF, at(4), at(5) ~ at(4)
      for k = 2, size - 3 do
         register = crc_step(register, at(k))
      end
      if register ~= at(size - 2) | at(size - 1) << 8 then
         self.bad_crc = self.bad_crc + 1
         return false
      end
      local body = {}
      for k = MESSAGE_HEAD_BYTES, size - 3 do
         body[#body + 1] = at(k) ~ mask
      end
      local message = KINDS[kind].parse(body)
      if not message then
         return false
      end
      self.good = self.good + 1
      drop(size)
      on_message(kind, message)
      return true
   end

   local function settle()
      while count >= wait do
         local size = needs()
         if size > count then
            wait = size
            return
         end
         if size == 0 or not deliver(size) then
            refuse()
         end
      end
   end

   -- drop the candidates that are too old
   function self.tell_time(now)
      while count > 0 and now - came[first] >= PAUSE_MS do
         refuse()
         settle()
      end
   end

   -- take one byte, after tell_time
   function self.take(byte, now)
      if count == 0 and byte ~= SYNC_0 then
         self.dropped = self.dropped + 1
         return
      end
      local k = first + count & 255
      held[k], came[k], count = byte, now, count + 1
      if count >= wait then
         settle()
      end
   end

   return self
end

-- the bytes of a command, in a table; nil if a value does not fit
local function encode_command(number, code, values)
   local bytes = {COMMAND, number & 255, code & 255}
   if #values > MAX_VALUES then
      return nil
   end
   for _, value in ipairs(values) do
      for shift = 0, 24, 8 do
         bytes[#bytes + 1] = value >> shift & 255
      end
   end
   local mask, k = 0, 1
   while k <= #bytes do
      if bytes[k] ~ mask == SYNC_0 then
         mask, k = mask + 1, 0
      end
      k = k + 1
   end
   local raw, register = {SYNC_0, SYNC_1, VERSION_2, #bytes + 1, mask}, 0xFFFF
   for _, byte in ipairs(bytes) do
      raw[#raw + 1] = byte ~ mask
   end
   for j = 3, #raw do
      register = crc_step(register, raw[j])
   end
   raw[#raw + 1], raw[#raw + 2] = register & 255, register >> 8
   return raw
end

--[[
   the host's commands on a port: sends one at a time, again when its answer is late, and tells on_end(text, answer) how
   it ended; answer is nil when none came
--]]
local function Commands(port, on_end)
   local self = {}
   local number, tries, sent_ms = 0, 0, 0
   local raw, asked, waiting     -- the command that waits for its answer, its text, and its code
   local decoder

   local function write(now)
      sent_ms, tries = now, tries + 1
      for _, byte in ipairs(raw) do
         port:write(byte)
      end
   end

   local function finish(text, answer)
      raw = nil
      on_end(asked .. ": " .. text, answer)
   end

   decoder = MessageDecoder({[ANSWER] = true}, function(_, answer)
      if raw and answer.number == number and answer.code == waiting then
         local words = {answer.result}
         for _, value in ipairs(answer.values) do
            words[#words + 1] = string.format("%d", value)
         end
         words[#words + 1] = answer.text ~= "" and answer.text or nil
         finish(table.concat(words, " "), answer)
      end
   end)

   -- the port to read; while a command waits, a port that also feeds each byte to the decoder of messages
   local shared = {
      read = function()
         local byte = port:read()
         if byte >= 0 then
            decoder.take(byte, self.now)
         end
         return byte
      end,
   }

   -- and the work allowed in a pass
   function self.source()
      if raw then
         return shared, MOST_WORK_SHARED
      end
      return port, MOST_WORK
   end

   -- send a command; false while another one waits for its answer, or if the values do not fit
   function self.send(code, values, now)
      if raw then
         return false
      end
      number, tries = number + 1 & 255, code == RESTART_CODE and TRIES - 1 or 0
      raw = encode_command(number, code, values)
      if not raw then
         return false
      end
      waiting, asked = code, table.concat({CODES[code] or string.format("command %d", code), table.unpack(values)}, " ")
      write(now)
      return true
   end

   function self.tell_time(now)
      self.now, decoder.left = now, MOST_CRC
      decoder.tell_time(now)
      if raw and now - sent_ms >= ANSWER_MS then
         if tries < TRIES then
            write(now)
         else
            finish("no answer", nil)
         end
      end
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

--[[
  // @Param: ARVA_CMD
  // @DisplayName: ARVA receiver command
  // @Description: Set to a command to send it to the receiver. It goes back to 0, and the answer comes as a text
  // @Values: 0:None,1:Identify,2:Mark,3:Unmark,4:Select,5:Restart,6:Channels,7:Scan,8:Search
  // @User: Standard
--]]
local ARVA_CMD = bind_add_param("CMD", 4, 0)

--[[
  // @Param: ARVA_CMD_VAL
  // @DisplayName: ARVA receiver command value
  // @Description: Value of the command, the id of a transmitter or the number of channels. -1: none
  // @Range: -1 254
  // @User: Standard
--]]
local ARVA_CMD_VAL = bind_add_param("CMD_VAL", 5, -1)

local function say(severity, ...)
   gcs:send_text(severity, "ARVA: " .. string.format(...))
end

--[[
   open the port at the time now, ms. Returns a table, or nil when the driver is off or has no port:
   update(now): to be called every 10 ms; hands each good frame to on_frame too, if that is given
   healthy: whether a good frame came in the last 3 s
   status: of the last good frame, 0 before the first
   command(code, values): send a command; false while one waits for its answer. The answer comes as a text
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

   local self = {healthy = false, status = 0}
   local decoder
   local heard = false          -- true after the first good frame
   local waiting = true         -- for a good frame or the end of the health time-out
   local frame_ms = now         -- when the last good frame came
   local knock_ms = now
   local counters_ms = now
   local dropped = 0            -- the count at the last good frame
   local commands = Commands(port, function(text)
      say(MAV_SEVERITY.INFO, "%s", text:sub(1, 44))
   end)

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
      heard, waiting, self.healthy, self.status = true, true, true, frame.status
      frame_ms, dropped = frame.time, decoder.dropped
      if on_frame then
         on_frame(frame)
      end
      publish(frame)
   end)

   -- an unplugged USB port may be detected, and opened again, only by a write
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

   function self.command(code, values)
      return commands.send(code, values, now)
   end

   -- a command from the parameter
   local function look_at_parameters()
      local code = math.floor(ARVA_CMD:get())
      if code > 0 then
         local value = math.floor(ARVA_CMD_VAL:get())
         if self.command(code, value >= 0 and {value} or {}) then
            ARVA_CMD:set_and_save(0)
         end
      end
   end

   function self.update(time)
      now = time
      commands.tell_time(now)
      local source, most_work = commands.source()
      decoder.read(source, now, most_work)
      look_at_parameters()
      knock()
      watch()
      log_counters()
   end

   return self
end

if ... then -- required by another script
   return {
      Decoder = Decoder, start = start,
      MessageDecoder = MessageDecoder, encode_command = encode_command,
   }
end

-- arva_search.lua next to this file reads the port itself; two readers would split the frames
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
