//! A server of object storage, and what lies in its bucket as another program finds it.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use tapline_testing::python_with;

use crate::cluster::Process;
use crate::sandbox::Sandbox;

/// A server with the bucket `plant`, which the programs of a sandbox use.
pub(crate) struct Bucket {
    python: OsString,
    pub(crate) server: Process,
    variables: Vec<(String, String)>,
}

impl Bucket {
    /// `None`, and a skip, where there is no server.
    pub(crate) fn start(sandbox: &mut Sandbox) -> Option<Self> {
        let python = python_with("moto.server, boto3")?;
        let mut command = Command::new(&python);
        command.args(["-m", "moto.server", "-H", "127.0.0.1", "-p", "0"]);
        let mut server = Process::start(command.stdout(Stdio::null()).stderr(Stdio::piped()));
        let mut lines = BufReader::new(server.0.stderr.take().unwrap()).lines();
        let address = loop {
            let line = lines.next().expect("the server says where it listens").unwrap();
            if let Some((_, address)) = line.split_once("Running on ") {
                break address.to_owned();
            }
        };
        std::thread::Builder::new().spawn(move || lines.for_each(drop)).unwrap();
        let variables = [
            ("AWS_ENDPOINT_URL", address.as_str()),
            ("AWS_ALLOW_HTTP", "true"),
            ("AWS_ACCESS_KEY_ID", "plant"),
            ("AWS_SECRET_ACCESS_KEY", "secret"),
            ("AWS_REGION", "us-east-1"),
        ];
        let variables: Vec<_> = variables.map(|(name, value)| (name.to_owned(), value.to_owned())).into();
        sandbox.variables.clone_from(&variables);
        let bucket = Self { python, server, variables };
        bucket.script("s3.create_bucket(Bucket='plant')");
        Some(bucket)
    }

    fn script(&self, script: &str) -> String {
        let mut command = Command::new(&self.python);
        let head = "import boto3, os, pathlib\ns3 = boto3.client('s3', region_name='us-east-1')\n";
        command.args(["-c", &format!("{head}{script}")]).envs(self.variables.iter().cloned());
        let done = command.output().unwrap();
        assert!(done.status.success(), "{script}: {}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8(done.stdout).unwrap()
    }

    /// Puts a file of the sandbox under a key.
    pub(crate) fn put(&self, sandbox: &Sandbox, file: &str, key: &str) {
        self.script(&format!("s3.upload_file('{}', 'plant', '{key}')", sandbox.path(file).display()));
    }

    /// All keys below `prefix`.
    pub(crate) fn keys(&self, prefix: &str) -> Vec<String> {
        let script = format!(
            "for o in s3.list_objects_v2(Bucket='plant', Prefix='{prefix}').get('Contents', []): print(o['Key'])"
        );
        self.script(&script).lines().map(str::to_owned).collect()
    }

    /// Has everything below `prefix` in the folder `to` of the sandbox.
    pub(crate) fn download(&self, sandbox: &Sandbox, prefix: &str, to: &str) -> PathBuf {
        let folder = sandbox.path(to);
        self.script(&format!(
            "for o in s3.list_objects_v2(Bucket='plant', Prefix='{prefix}/').get('Contents', []):
    to = pathlib.Path('{}', o['Key'].removeprefix('{prefix}/'))
    to.parent.mkdir(parents=True, exist_ok=True)
    s3.download_file('plant', o['Key'], str(to))",
            folder.display()
        ));
        folder
    }
}
