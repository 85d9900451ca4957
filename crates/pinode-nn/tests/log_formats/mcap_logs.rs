//! MCAP, written by its Python packages or message by message here: topics with times of their own, and what damaged files say.

use std::collections::BTreeMap;
use std::io::Cursor;

use lagrange::Coordinate;
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use pinode_nn::log::{Channels, ColumnMap, Log};

use super::{
    assert_same, coordinate, data, mapped, parse, problems, read, read_mapped,
    refused_when_flipped, told,
};

/// Messages in JSON: topic, time in ms, text.
fn file(messages: &[(&str, u64, String)]) -> Vec<u8> {
    checked_file(messages, true)
}

/// Without checksums the reader meets what is damaged itself.
fn checked_file(messages: &[(&str, u64, String)], checksums: bool) -> Vec<u8> {
    let mut writer = WriteOptions::default()
        .compression(None)
        .chunk_size(Some(500))
        .calculate_chunk_crcs(checksums)
        .calculate_data_section_crc(checksums)
        .create(Cursor::new(Vec::new()))
        .unwrap();
    write(&mut writer, messages);
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn write(writer: &mut Writer<Cursor<Vec<u8>>>, messages: &[(&str, u64, String)]) {
    for (topic, ms, text) in messages {
        let channel_id = writer
            .add_channel(0, topic, "json", &BTreeMap::new())
            .unwrap();
        let time = ms * 1_000_000;
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time: time,
            publish_time: time,
        };
        writer
            .write_to_known_channel(&header, text.as_bytes())
            .unwrap();
    }
}

const FIRST: u64 = 5_000;

/// A slider every 20 ms, from `FIRST` on, a pole every 8 ms and a motor every 50 ms, each beginning and ending by itself.
fn three_topics() -> Vec<(&'static str, u64, String)> {
    let mut messages = Vec::new();
    for i in 0..100 {
        let ms = FIRST + 20 * i;
        messages.push((
            "/slider",
            ms,
            format!("{{\"q.slider\": {i}, \"v\": {{\"slider\": 1}}}}"),
        ));
    }
    for i in 0..200 {
        let ms = FIRST + 100 + 8 * i;
        // An angle that goes round: 0.1 rad/ms, from −π to π.
        let angle = 0.1 * ms as f64;
        let angle = angle.sin().atan2(angle.cos());
        messages.push(("/encoder", ms, format!("{{\"angles\": [0, {angle}]}}")));
    }
    for i in 0..40 {
        let ms = FIRST + 10 + 50 * i;
        messages.push((
            "/drive",
            ms,
            format!("{{\"u.motor\": {ms}, \"mode\": \"torque\"}}"),
        ));
    }
    messages.sort_by_key(|(_, ms, _)| *ms);
    messages
}

#[test]
fn one_topic_in_json_is_the_same_log_as_csv() {
    let csv = read("rig.csv").unwrap();
    let log = read("json.mcap").unwrap();
    assert_same(&log, &csv);
    let told = told(&log);
    assert!(
        told.contains("topics not read: `/odd` (protobuf); messages are read in JSON"),
        "{told}"
    );
    assert!(
        told.contains("columns not used: `/rig.temperature`"),
        "{told}"
    );
}

#[test]
fn joint_states_of_ros_2_are_the_same_log_as_csv_whatever_the_order_of_the_joints() {
    let csv = read("rig.csv").unwrap();
    let motor = mapped(&[("u.motor", "/motor/command.data")]);
    let log = read_mapped("ros2.mcap", &motor).unwrap();
    assert_same(&log, &csv);
    let told = told(&log);
    for words in ["interpolated", "header"] {
        assert!(!told.contains(words), "{told}");
    }
    assert!(
        told.contains("no stamps in the messages of `/motor/command`"),
        "{told}"
    );

    // A message with everything that a definition may have, read to its last field.
    let log = read_mapped("ros2.mcap", &mapped(&[("u.motor", "/status.force")])).unwrap();
    assert_same(&log, &csv);
    let log = read_mapped("ros2.mcap", &mapped(&[("u.motor", "/status.main.serial")])).unwrap();
    assert_eq!(log.runs[0].u[0][79], -79.0);
}

#[test]
fn a_column_that_is_missing_is_told_with_its_neighbours_and_what_was_not_read() {
    let message = problems(read("ros2.mcap"));
    assert!(
        message.contains("column `u.motor` is missing; nearest: `"),
        "{message}"
    );

    let motor = mapped(&[("u.motor", "/motor/comand.data")]);
    let message = problems(read_mapped("ros2.mcap", &motor));
    assert!(
        message.contains("`/motor/comand.data` (for u.motor, by [log.columns]) is missing; nearest: `/motor/command.data`"),
        "{message}"
    );
    let message = problems(read_mapped(
        "json.mcap",
        &mapped(&[("u.motor", "/odd.force")]),
    ));
    assert!(
        message.contains("topics not read: `/odd` (protobuf)"),
        "{message}"
    );
}

#[test]
fn topics_of_other_rates_are_interpolated_and_inputs_are_held() {
    let pole = mapped(&[("q.pole", "/encoder.angles[1]")]);
    let log = parse("three.mcap", &file(&three_topics()), &pole).unwrap();
    let run = &log.runs[0];
    // The encoder begins last and ends first, 1692 ms after the slider began.
    let told = told(&log);
    assert!(
        told.contains(
            "5 rows left out before the first at which every signal has a value, 15 after the last"
        ),
        "{told}"
    );
    assert!(
        told.contains("`/encoder.angles[1]` is interpolated to the times of `/slider`, between messages up to 0.008 s apart"),
        "{told}"
    );
    assert_eq!(run.len(), 80);
    assert_eq!((run.t[0], run.t[1], run.t[79]), (0.0, 0.02, 1.58));
    assert_eq!((run.q[0][0], run.q[0][79]), (5.0, 84.0));
    assert!(run.v[0].is_some() && run.v[1].is_none());
    for (k, angle) in run.q[1].iter().enumerate() {
        let ms = (FIRST + 100 + 20 * k as u64) as f64;
        let off = angle - 0.1 * ms;
        assert!(
            off.sin().abs() < 1e-9 && off.cos() > 0.0,
            "row {k}: {angle}"
        );
        let held = (ms - FIRST as f64 - 10.0).div_euclid(50.0) * 50.0 + 10.0;
        assert_eq!(run.u[0][k], FIRST as f64 + held, "row {k}");
    }
}

/// Half way between q and −q, which are one orientation, lies a quaternion of length 0: such a log was refused for it.
#[test]
fn orientations_are_interpolated_whichever_of_two_quaternions_was_sent() {
    let mut messages = Vec::new();
    for i in 0..100_u64 {
        let ms = 20 * i;
        messages.push((
            "/place",
            ms,
            format!("{{\"q\": {{\"base\": {{\"x\": {i}, \"y\": 0, \"z\": 0}}}}}}"),
        ));
    }
    // 2 rad/s about x, every 30 ms, of changing signs.
    let turn = |ms: u64| 2e-3 * ms as f64;
    for i in 0..70_u64 {
        let ms = 30 * i;
        let sign = [1.0, -1.0, -1.0, 1.0, -1.0][i as usize % 5];
        let (sin, cos) = (0.5 * turn(ms)).sin_cos();
        let text = format!(
            "{{\"qw\": {}, \"qx\": {}, \"qy\": 0, \"qz\": 0}}",
            sign * cos,
            sign * sin
        );
        messages.push(("/imu", ms, text));
    }
    messages.sort_by_key(|(_, ms, _)| *ms);
    let parts =
        ["qw", "qx", "qy", "qz"].map(|part| (format!("q.base.{part}"), format!("/imu.{part}")));
    let parts: Vec<(&str, &str)> = parts
        .iter()
        .map(|(a, b)| (a.as_str(), b.as_str()))
        .collect();
    let base = Coordinate {
        floating: true,
        ..coordinate("base")
    };
    let channels = Channels {
        coordinates: &[base],
        velocities: &[true],
        inputs: &[],
        columns: &mapped(&parts),
    };
    let log = Log::parse("imu.mcap".as_ref(), &file(&messages), &channels).unwrap();
    let run = &log.runs[0];
    assert!(run.len() > 90);
    for k in 0..run.len() {
        let [w, x] = [3, 4].map(|part| run.q[part][k]);
        assert!((w.hypot(x) - 1.0).abs() < 1e-12, "{k}: {w} {x}");
        let off = 2.0 * x.atan2(w) - turn(20 * k as u64);
        assert!((0.5 * off).sin().abs() < 1e-5, "{k}: {off}");
    }
    assert!(
        told(&log).contains("`/imu.qw` is interpolated"),
        "{}",
        told(&log)
    );
}

#[test]
fn messages_out_of_order_are_read_in_the_order_of_their_times() {
    let pole = mapped(&[("q.pole", "/encoder.angles[1]")]);
    let ordered = parse("three.mcap", &file(&three_topics()), &pole).unwrap();
    let mut messages = three_topics();
    for pair in messages.chunks_mut(7) {
        pair.reverse();
    }
    let log = parse("three.mcap", &file(&messages), &pole).unwrap();
    assert_same(&log, &ordered);
}

#[test]
fn what_is_no_number_is_told_by_topic_and_time() {
    let pole = mapped(&[("q.pole", "/encoder.angles[1]")]);
    let mut messages = three_topics();
    for (topic, ms, text) in &mut messages {
        match (*topic, *ms - FIRST) {
            ("/slider", 400) => *text = "{\"q.slider\": null}".into(),
            ("/drive", 510) => *text = "{\"u.motor\": \"off\"}".into(),
            ("/drive", 710) => *text = "{\"u.motor\": 1".into(),
            _ => {}
        }
    }
    let message = problems(parse("faulty.mcap", &file(&messages), &pole));
    for words in [
        "faulty.mcap: a message of `/drive` at 5.710000000 s cannot be read: EOF",
        "faulty.mcap: `/slider` at 5.400000000 s (row at 0.300 s): `/slider.q.slider` is NaN: every entry",
        "`/slider` at 5.520000000 s (row at 0.420 s): `/drive.u.motor` is NaN",
    ] {
        assert!(message.contains(words), "no {words:?} in\n{message}");
    }
}

#[test]
fn signals_on_two_topics_must_be_told_apart() {
    let mut messages = three_topics();
    messages.push(("/copy", FIRST, "{\"q.slider\": 1}".into()));
    let pole = mapped(&[("q.pole", "/encoder.angles[1]")]);
    let message = problems(parse("two.mcap", &file(&messages), &pole));
    assert!(
        message.contains(
            "`q.slider` could be `/slider.q.slider` or `/copy.q.slider`: say which by [log.columns]"
        ),
        "{message}"
    );
    let both = mapped(&[
        ("q.pole", "/encoder.angles[1]"),
        ("q.slider", "/slider.q.slider"),
    ]);
    assert!(parse("two.mcap", &file(&messages), &both).is_ok());
}

#[test]
fn runs_are_told_apart_by_a_field() {
    let messages: Vec<_> = (0..40_u64)
        .map(|i| {
            let run = if i < 20 { "first" } else { "second" };
            let text = format!(
                "{{\"q.slider\": {i}, \"q.pole\": {i}, \"u.motor\": 0, \"run\": \"{run}\"}}"
            );
            ("rig", 10 * i, text)
        })
        .collect();
    let log = parse("runs.mcap", &file(&messages), &ColumnMap::default()).unwrap();
    let ids: Vec<&str> = log.runs.iter().map(|run| run.id.as_str()).collect();
    assert_eq!(ids, ["first", "second"]);
    assert_eq!(log.runs[1].q[0][0], 20.0);
}

#[test]
fn topics_that_never_meet_are_told_with_their_times() {
    let messages: Vec<_> = (0..20_u64)
        .flat_map(|i| {
            let state = format!("{{\"q.slider\": {i}, \"q.pole\": {i}}}");
            [
                ("/rig", 10 * i, state),
                ("/drive", 9_000 + i, "{\"u.motor\": 1}".into()),
            ]
        })
        .collect();
    let message = problems(parse("apart.mcap", &file(&messages), &ColumnMap::default()));
    assert!(
        message.contains("at no message of `/rig` has every signal a value")
            && message.contains("`/drive.u.motor` from 9.000000000 to 9.019000000 s"),
        "{message}"
    );
}

#[test]
fn truncated_files_are_refused_at_every_length() {
    for name in ["json.mcap", "ros2.mcap"] {
        let file = std::fs::read(data(name)).unwrap();
        let motor = mapped(&[("u.motor", "/motor/command.data")]);
        for length in (8..file.len())
            .step_by(37)
            .chain(file.len() - 9..file.len())
        {
            let message = problems(parse(name, &file[..length], &motor));
            assert!(message.starts_with(name), "{message}");
            assert!(message.contains("`mcap recover`"), "{message}");
        }
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let plain = checked_file(&three_topics(), false);
    let pole = mapped(&[("q.pole", "/encoder.angles[1]")]);
    let motor = mapped(&[("u.motor", "/motor/command.data")]);
    let read = |name| std::fs::read(data(name)).unwrap();
    let refused = [
        refused_when_flipped(&plain, 23, &pole),
        refused_when_flipped(&read("json.mcap"), 23, &ColumnMap::default()),
        refused_when_flipped(&read("ros2.mcap"), 23, &motor),
    ];
    assert!(refused.iter().all(|refused| *refused > 100), "{refused:?}");
}

/// Two joints in CDR: names, positions, velocities.
fn joint_state(position: [f64; 2], velocity: [f64; 2]) -> Vec<u8> {
    let mut body = 2_u32.to_le_bytes().to_vec();
    for name in ["slider", "pole"] {
        body.resize(body.len().next_multiple_of(4), 0);
        body.extend((name.len() as u32 + 1).to_le_bytes());
        body.extend(name.as_bytes());
        body.push(0);
    }
    for numbers in [position, velocity] {
        body.resize(body.len().next_multiple_of(4), 0);
        body.extend(2_u32.to_le_bytes());
        body.resize(body.len().next_multiple_of(8), 0);
        body.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
    }
    [vec![0, 1, 0, 0], body].concat()
}

#[test]
fn velocities_that_are_never_measured_are_no_velocities() {
    let messages = (0..20).map(|i| {
        let x = f64::from(i);
        joint_state(
            [x, 2.0 * x],
            [f64::NAN, if i == 9 { f64::NAN } else { 2.0 }],
        )
    });
    let definition = "string[] name\nfloat64[] position\nfloat64[] velocity";
    let file = ros_file("sensor_msgs/msg/JointState", definition, messages);
    let motor = mapped(&[("u.motor", "/rig.position[slider]")]);
    // One that is missing in between is a fault.
    let message = problems(parse("rig.mcap", &file, &motor));
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(
        message.contains("`/rig.velocity[pole]` is NaN"),
        "{message}"
    );
}

/// Messages on `/rig` of one type, every 10 ms.
fn ros_file(name: &str, definition: &str, messages: impl Iterator<Item = Vec<u8>>) -> Vec<u8> {
    let mut writer = WriteOptions::default()
        .create(Cursor::new(Vec::new()))
        .unwrap();
    let schema = writer
        .add_schema(name, "ros2msg", definition.as_bytes())
        .unwrap();
    let channel_id = writer
        .add_channel(schema, "/rig", "cdr", &BTreeMap::new())
        .unwrap();
    for (i, message) in (0_u64..).zip(messages) {
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time: i * 10_000_000,
            publish_time: i * 10_000_000,
        };
        writer.write_to_known_channel(&header, &message).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// Messages that are what they were when written, but not what their definition says.
#[test]
fn messages_of_the_wrong_length_are_told_by_topic_and_time() {
    let messages = (0..20_u8).map(|i| {
        let message = vec![0, 1, 0, 0, 0, 0, 0, 0, 0, 0, i, 0x40];
        message[..if i == 12 { 9 } else { 12 }].to_vec()
    });
    let file = ros_file("std_msgs/msg/Float64", "float64 data", messages);
    let all = mapped(&[
        ("q.slider", "/rig.data"),
        ("q.pole", "/rig.data"),
        ("u.motor", "/rig.data"),
    ]);
    let message = problems(parse("cut.mcap", &file, &all));
    assert!(
        message.contains("a message of `/rig` at 0.120000000 s cannot be read: it ends after 9 bytes, in its field `data`"),
        "{message}"
    );
}
