//! Stands in for Haply's Inverse service: the same JSON over a WebSocket around a simulated arm.

use std::net::TcpListener;
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread;

use serde_json::{Value, json};
use tungstenite::Message;

/// What the service knows and what it got.
pub struct World {
    pub arm_id: &'static str,
    pub is_present: bool,
    pub is_silent: bool,
    pub is_calibrated: bool,
    pub position_m: [f64; 3],
    pub orientation_wxyz: [f64; 4],
    /// Forces that it was told, N, in its own frame.
    pub forces_n: Vec<[f64; 3]>,
    pub profiles: Vec<String>,
    pub is_closed: bool,
}

pub struct Service {
    pub url: String,
    world: Arc<Mutex<World>>,
}

impl Service {
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("ws://{}", listener.local_addr().unwrap());
        let world = Arc::new(Mutex::new(World {
            arm_id: "049D",
            is_present: true,
            is_silent: false,
            is_calibrated: true,
            position_m: [0.01, -0.12, 0.15],
            orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
            forces_n: Vec::new(),
            profiles: Vec::new(),
            is_closed: false,
        }));
        let shared = world.clone();
        // It ends with the process, as the service outlives its clients.
        thread::spawn(move || listener.incoming().for_each(|stream| serve(stream.unwrap(), &shared)));
        Self { url, world }
    }

    pub fn world(&self) -> MutexGuard<'_, World> {
        self.world.lock().unwrap()
    }
}

fn serve(stream: std::net::TcpStream, world: &Mutex<World>) {
    stream.set_nodelay(true).unwrap();
    let mut socket = tungstenite::accept(stream).unwrap();
    let first = state(&world.lock().unwrap(), true);
    socket.send(Message::text(first.to_string())).unwrap();
    while let Ok(message) = socket.read() {
        let Message::Text(text) = message else { continue };
        let answer = {
            let mut world = world.lock().unwrap();
            take(&mut world, &serde_json::from_str(&text).unwrap());
            (!world.is_silent).then(|| state(&world, false))
        };
        if let Some(answer) = answer {
            socket.send(Message::text(answer.to_string())).unwrap();
        }
    }
    world.lock().unwrap().is_closed = true;
}

fn take(world: &mut World, command: &Value) {
    if let Some(name) = command["session"]["configure"]["profile"]["name"].as_str() {
        world.profiles.push(name.to_owned());
    }
    let arm = &command["inverse3"][0];
    assert_eq!(arm["device_id"], world.arm_id);
    let vector = &arm["commands"]["set_cursor_force"]["vector"];
    world.forces_n.push(["x", "y", "z"].map(|axis| vector[axis].as_f64().unwrap()));
}

fn state(world: &World, is_first: bool) -> Value {
    let [x, y, z] = world.position_m;
    let [qw, qx, qy, qz] = world.orientation_wxyz;
    let mut arm = json!({
        "device_id": world.arm_id,
        "state": {
            "cursor_position": { "x": x, "y": y, "z": z },
            "cursor_velocity": { "x": 0.1, "y": 0.2, "z": 0.3 },
            "control_mode": "idle",
        },
        "status": { "calibrated": world.is_calibrated, "power_supply": true, "ready": true, "started": true },
    });
    if is_first {
        arm["config"] = json!({ "type": "inverse3", "extended_firmware_version": "8C20FDC8" });
    }
    json!({
        "session_id": 7,
        "inverse3": if world.is_present { vec![arm] } else { Vec::new() },
        "verse_grip": [],
        "wireless_verse_grip": [{
            "device_id": "61548",
            "state": {
                "orientation": { "w": qw, "x": qx, "y": qy, "z": qz },
                "buttons": { "a": false, "b": true, "c": false },
            },
        }],
    })
}
