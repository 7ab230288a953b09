"""Makes an authority and the certificate of a server at 127.0.0.1: FOLDER/ca.pem, server.pem and server.key, and another authority
that has vouched for nothing: other.pem.

usage: certificates.py FOLDER
"""
import datetime
import ipaddress
import pathlib
import sys

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

folder = pathlib.Path(sys.argv[1])
now = datetime.datetime.now(datetime.timezone.utc)
pem = serialization.Encoding.PEM


def named(text):
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def make(subject, key, issuer, signed_by, extension):
    builder = x509.CertificateBuilder().subject_name(named(subject)).issuer_name(named(issuer)).public_key(key.public_key())
    builder = builder.serial_number(x509.random_serial_number())
    builder = builder.not_valid_before(now - datetime.timedelta(hours=1)).not_valid_after(now + datetime.timedelta(days=1))
    return builder.add_extension(extension, critical=False).sign(signed_by, hashes.SHA256())


for name in ["ca", "other"]:
    key = ec.generate_private_key(ec.SECP256R1())
    authority = make(name, key, name, key, x509.BasicConstraints(ca=True, path_length=None))
    (folder / f"{name}.pem").write_bytes(authority.public_bytes(pem))
    if name == "ca":
        server = ec.generate_private_key(ec.SECP256R1())
        names = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
        (folder / "server.pem").write_bytes(make("server", server, "ca", key, names).public_bytes(pem))
        text = server.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
        (folder / "server.key").write_bytes(text)
