# view_client.py PORT COMMAND...: talks to `portmetd view` with Python's standard library alone. A
# command prints its result, and the program fails if there is none within 10 s.
#   get PATH [HEADER: VALUE]...     prints the status and the body of an answer
#   send METHOD PATH                prints the status of another method than GET
#   listen KIND [HEADER: VALUE]...  prints the first websocket message of a kind: scene, frame, health
#   last                            prints the last frame that comes within a second
#   follow                          reads messages until it is ended
#   talk                            sends something over the websocket, then prints the next frame
#   ask WORD                        sends a word, then prints what the service says to it
#   crowd N                         opens N websockets that stay, then prints the first scene that one more gets
#   datagram KEY                    prints the first datagram at UDP port PORT that has the key
import base64
import json
import os
import socket
import struct
import sys
import time

PATIENCE = 10  # s


def connect(port):
    return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)


def request(port, method, path, headers):
    s = connect(port)
    fields = {"Host": f"127.0.0.1:{port}", "Connection": "close"}
    fields.update(h.split(": ", 1) for h in headers)
    lines = [f"{method} {path} HTTP/1.1"] + [f"{k}: {v}" for k, v in fields.items()]
    s.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
    answer = b""
    try:
        while piece := s.recv(65536):
            answer += piece
    except ConnectionResetError:
        pass
    return answer.decode()


def status(answer):
    return answer.split(" ")[1] if answer.startswith("HTTP/1") else "closed"


def read(s, count):
    data = b""
    while len(data) < count:
        piece = s.recv(count - len(data))
        if not piece:
            sys.exit("the websocket was closed")
        data += piece
    return data


def open_websocket(port, headers):
    s = connect(port)
    fields = {"Host": f"127.0.0.1:{port}", "Upgrade": "websocket", "Connection": "Upgrade",
              "Sec-WebSocket-Key": base64.b64encode(os.urandom(16)).decode(),
              "Sec-WebSocket-Version": "13"}
    fields.update(h.split(": ", 1) for h in headers)
    lines = ["GET / HTTP/1.1"] + [f"{k}: {v}" for k, v in fields.items()]
    s.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
    answer = b""
    while not answer.endswith(b"\r\n\r\n"):
        piece = s.recv(1)
        if not piece:
            break
        answer += piece
    code = status(answer.decode())
    if code != "101":
        print(code)
        sys.exit(0)
    return s


def messages(s):
    while True:
        first, size = read(s, 2)
        if size == 126:
            size, = struct.unpack(">H", read(s, 2))
        elif size == 127:
            size, = struct.unpack(">Q", read(s, 8))
        payload = read(s, size)
        if first & 15 == 1:
            yield json.loads(payload)


def listen(port, kind, headers):
    for message in messages(open_websocket(port, headers)):
        if kind in message:
            return json.dumps(message[kind])


def last(port):
    s, frame, end = open_websocket(port, []), None, time.monotonic() + PATIENCE
    try:
        for message in messages(s):
            if "frame" in message and frame is None:
                end = time.monotonic() + 1
            frame = message.get("frame", frame)
            s.settimeout(max(0.01, end - time.monotonic()))
    except TimeoutError:
        pass
    return frame


def talk(port, text, kind):
    s = open_websocket(port, [])
    next(messages(s))  # the scene
    s.sendall(bytes([0x81, 0x80 | len(text), 0, 0, 0, 0]) + text.encode())
    for message in messages(s):
        if kind in message:
            return json.dumps(message[kind])


def crowd(port, count):
    sitting = [open_websocket(port, []) for _ in range(count)]
    text = listen(port, "scene", [])
    for s in sitting:
        s.close()
    return text


def datagram(port, key):
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind(("127.0.0.1", port))
    s.settimeout(PATIENCE)
    while True:
        values = json.loads(s.recv(65536))
        if any(key in inner for inner in values.values() if isinstance(inner, dict)):
            return json.dumps(values)


def main(port, command, *arguments):
    if command == "get":
        answer = request(port, "GET", arguments[0], arguments[1:])
        print(status(answer), answer.partition("\r\n\r\n")[2], sep="\n")
    elif command == "send":
        print(status(request(port, arguments[0], arguments[1], ["Content-Length: 0"])))
    elif command == "listen":
        print(listen(port, arguments[0], arguments[1:]))
    elif command == "last":
        print(json.dumps(last(port)))
    elif command == "follow":
        s = open_websocket(port, [])
        s.settimeout(None)
        print(sum(1 for _ in messages(s)))
    elif command == "talk":
        print(talk(port, '{"command": "stop"}', "frame"))
    elif command == "ask":
        print(talk(port, arguments[0], "control"))
    elif command == "crowd":
        print(crowd(port, int(arguments[0])))
    else:
        print(datagram(port, *arguments))


main(int(sys.argv[1]), *sys.argv[2:])
